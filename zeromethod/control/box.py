"""Running sums and means over square neighbourhoods of nodes; the cost does not depend on their size."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float


@numba.njit(cache=True)
def _box_lines(field: Float, radius: int, out: Float) -> None:
    """Sums over 2 radius + 1 lines along axis 0, fewer at the ends."""
    rows = field.shape[0]
    total = np.zeros(field.shape[1])
    for j in range(-radius, rows):
        if j + radius < rows:
            for i in range(total.size):
                total[i] += field[j + radius, i]
        if j >= 0:
            for i in range(total.size):
                out[j, i] = total[i]
            if j >= radius:
                for i in range(total.size):
                    total[i] -= field[j - radius, i]


@numba.njit(cache=True)
def _box_columns(field: Float, radius: int) -> None:
    """Sums over 2 radius + 1 nodes along axis 1, fewer at the ends, in place."""
    cols = field.shape[1]
    line = np.zeros(cols + 2 * radius + 1)
    for j in range(field.shape[0]):
        # a loop, as numba takes two seconds longer to compile a slice
        for i in range(cols):
            line[radius + 1 + i] = field[j, i]
        total = 0.0
        for i in range(radius):
            total += line[radius + 1 + i]
        for i in range(cols):
            # one sum after the other waits for the one before: their difference does not
            total += line[i + 2 * radius + 1] - line[i]
            field[j, i] = total


@numba.njit(cache=True)
def box_sum(field: Float, radius: int, out: Float) -> None:
    """Sum of `field` (rows, cols) over the (2 radius + 1)^2 nodes around each, cut at the edge, in `out`."""
    _box_lines(field, radius, out)
    _box_columns(out, radius)


@numba.njit(cache=True)
def box_mean(field: Float, radius: int, out: Float) -> None:
    """Mean of `field` (rows, cols) over the (2 radius + 1)^2 nodes around each, cut at the edge, in `out`."""
    box_sum(field, radius, out)
    rows, cols = field.shape
    for j in range(rows):
        height = min(j + radius, rows - 1) - max(j - radius, 0) + 1
        for i in range(cols):
            width = min(i + radius, cols - 1) - max(i - radius, 0) + 1
            out[j, i] /= height * width
