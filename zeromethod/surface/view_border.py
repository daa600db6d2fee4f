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
from zeromethod.kernels import kernel, read

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
    _add_across(slope, point, valid, square)
    _add_across(slope.swapaxes(0, 1), point.swapaxes(0, 1), valid.T, square.T)
    return np.asarray(np.sqrt(square))


def _add_across(slope: Float, point: Float, valid: Mask, square: Float) -> None:
    """Add the variance, mm^2, that the first and last rows with valid nodes make, to theirs and the next."""
    rows = np.flatnonzero(valid.any(axis=1))
    if not len(rows) or rows[-1] - rows[0] < _ROWS - 1:
        return
    for strip in (rows[0] + np.arange(_ROWS), rows[-1] - np.arange(_ROWS)):
        size2 = np.empty(valid.shape[1])
        _bent(point[strip, :, :2], slope[strip], valid[strip], _BEND, size2)
        near = strip[:_NEAR]
        # NaN where a row has no node around
        square[near] += np.where(valid[near] & (size2 > 0.0), size2 / (_ROWS - 1) ** 2, 0.0)


@kernel(
    read(numba.float64, 3), read(numba.float64, 3), read(numba.boolean, 2), read(numba.float64, 1),
    numba.float64[::1],
)  # fmt: skip
def _bent(point: Float, slope: Float, valid: Mask, bend: Float, size2: Float) -> None:
    """Square (cols,) of the bend of slopes times the way from the first row to the last, mm^2.

    Each row counts with the mean of its valid nodes around a column. NaN where a row has none.
    """
    rows, cols = valid.shape
    for j in range(cols):
        bend_x = bend_y = way_x = way_y = 0.0
        for k in range(rows):
            count = 0
            x = y = slope_x = slope_y = 0.0
            for m in range(max(j - _ASIDE, 0), min(j + _ASIDE + 1, cols)):
                if valid[k, m]:
                    count += 1
                    x, y = x + point[k, m, 0], y + point[k, m, 1]
                    slope_x, slope_y = slope_x + slope[k, m, 0], slope_y + slope[k, m, 1]
            bend_x, bend_y = bend_x + bend[k] * slope_x / count, bend_y + bend[k] * slope_y / count
            if k == 0:
                way_x, way_y = -x / count, -y / count
            elif k == rows - 1:
                way_x, way_y = way_x + x / count, way_y + y / count
        size2[j] = (bend_x * way_x) ** 2 + (bend_y * way_y) ** 2
