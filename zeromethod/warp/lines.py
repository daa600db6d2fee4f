"""Rows of nodes with their two components apart: arithmetic on such lines is vectorised by the compiler."""

from __future__ import annotations

import numba

from zeromethod.arrays import Float


@numba.njit(cache=True)
def split(row: Float, x: Float, y: Float) -> None:
    """Both components of a row (cols, 2), each in a line (cols,) of its own."""
    for i in range(x.size):
        x[i], y[i] = row[i, 0], row[i, 1]
