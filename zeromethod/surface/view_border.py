"""What the view's border does to depth near it: beyond it the picture is drawn from a guess.

The sensing windows of the last rows of nodes reach over nodes that nothing measures, whose warp is continued
linearly. Where the mirror bends there, the continuation misses, the null makes up for it in those rows, and
depth next to the border is off by about the bend of the slopes across it, times the distance of nodes (0.3 to
0.8 of it by pads of 2.4 to 4 nodes sigma, on and beyond the border of a simulated bench).
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Mask

_NEAR = 3
"""Rows of nodes whose windows reach over the border, and one more."""

_ROWS = 6
"""Rows by which the bend across the border is measured."""

_ASIDE = 2
_BEND = 2.0 * np.linalg.pinv(np.vander(np.arange(_ROWS, dtype=np.float64), 3))[0]
"""Weights that give the second difference of a row's values, by least squares."""


def border_sigma_mm(slope: Float, point: Float, valid: Mask) -> Float:
    """Standard deviation (rows, cols) of depth by the view's border, mm; 0 further inside.

    slope: (rows, cols, 2) rad. point: (rows, cols, 2 or more) mirror points, mm. valid: (rows, cols).
    """
    square = np.zeros(valid.shape)
    _add_across(slope, point, valid, _BEND, square)
    _add_across(slope.swapaxes(0, 1), point.swapaxes(0, 1), valid.T, _BEND, square.T)
    return np.asarray(np.sqrt(square))


@numba.njit(cache=True, error_model="numpy")
def _add_across(slope: Float, point: Float, valid: Mask, bend: Float, square: Float) -> None:
    """Add the variance, mm^2, that the first and last rows with valid nodes make, to theirs and the next."""
    rows, cols = valid.shape
    first, last = 0, rows - 1
    while first < last and not valid[first].any():
        first += 1
    while last > first and not valid[last].any():
        last -= 1
    if last - first < _ROWS - 1:
        return
    for edge, inwards in ((first, 1), (last, -1)):
        for j in range(cols):
            from_x, from_y, _, _ = _around(point, slope, valid, edge, j)
            to_x = to_y = bend_x = bend_y = 0.0
            for k in range(_ROWS):
                to_x, to_y, slope_x, slope_y = _around(point, slope, valid, edge + inwards * k, j)
                bend_x, bend_y = bend_x + bend[k] * slope_x, bend_y + bend[k] * slope_y
            size2 = (bend_x * (to_x - from_x)) ** 2 + (bend_y * (to_y - from_y)) ** 2
            for k in range(_NEAR):
                i = edge + inwards * k
                # NaN where a row has no node around
                if valid[i, j] and size2 > 0.0:
                    square[i, j] += size2 / (_ROWS - 1) ** 2


@numba.njit(cache=True, error_model="numpy", inline="always")
def _around(point: Float, slope: Float, valid: Mask, i: int, j: int) -> tuple[float, float, float, float]:
    """Mean point and slope of the valid nodes of a row around a column; NaN without any."""
    count = 0
    x = y = slope_x = slope_y = 0.0
    for k in range(max(j - _ASIDE, 0), min(j + _ASIDE + 1, valid.shape[1])):
        if valid[i, k]:
            count += 1
            x, y = x + point[i, k, 0], y + point[i, k, 1]
            slope_x, slope_y = slope_x + slope[i, k, 0], slope_y + slope[i, k, 1]
    return x / count, y / count, slope_x / count, slope_y / count
