"""What the view's border does to a peak near it: beyond it the picture is drawn from a guess.

The sensing windows of the last rows of nodes reach over nodes that nothing measures, whose warp is continued
linearly. Where the mirror bends there, the continuation misses, the null makes up for it in those rows, and
depth next to the border is off by about the bend of the slopes across it, times the distance of nodes (0.3 to
0.8 of it by pads of 2.4 to 4 nodes sigma, on and beyond the border of a simulated bench).
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.surface import Surface

_NEAR = 3
"""Rows of nodes whose windows reach over the border, and one more."""

_ROWS = 6
"""Rows by which the bend across the border is measured."""

_ASIDE = 2
_BEND = 2.0 * np.linalg.pinv(np.vander(np.arange(_ROWS, dtype=np.float64), 3))[0]
"""Weights that give the second difference of a row's values, by least squares."""


def border_sigma_mm(surface: Surface, row: int, col: int) -> float:
    """Standard deviation of depth at a node by the view's border, mm; 0 further inside."""
    x, y, valid = surface.x_mm, surface.y_mm, surface.valid
    along = _across(surface.slope, (x, y), valid, row, col)
    return float(np.hypot(along, _across(surface.slope.swapaxes(0, 1), (x.T, y.T), valid.T, col, row)))


def _across(slope: Float, point: tuple[Float, Float], valid: Mask, row: int, col: int) -> float:
    """The same of the first and last rows alone; point: x and y (rows, cols)."""
    seen = np.flatnonzero(valid.any(axis=1))
    aside = slice(max(col - _ASIDE, 0), col + _ASIDE + 1)
    square = 0.0
    for edge, inwards in ((seen[0], 1), (seen[-1], -1)):
        rows = edge + inwards * np.arange(_ROWS)
        if abs(row - edge) >= _NEAR or rows.min() < 0 or rows.max() >= len(valid):
            continue
        known = valid[rows, aside][..., None]
        if not known.any(axis=1).all():
            continue
        count = known.sum(axis=1)
        mean_slope, place = (
            np.where(known, one, 0.0).sum(axis=1) / count
            for one in (slope[rows, aside], np.stack([one[rows, aside] for one in point], axis=-1))
        )
        step = (place[-1] - place[0]) / (_ROWS - 1)
        square += float((((_BEND @ mean_slope) * step) ** 2).sum())
    return float(np.sqrt(square))
