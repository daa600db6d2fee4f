"""Runs of nodes along the rows of a lattice."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Ints, Mask


def runs(nodes: Mask) -> tuple[Ints, Ints, Ints]:
    """Row, first column, and that after the last, (n,) each, of the runs of nodes (rows, cols) along rows."""
    row, column = np.nonzero(np.diff(nodes, axis=1, prepend=False, append=False))
    return row[::2], column[::2], column[1::2]
