"""What single pixels see beyond the nodes: LCD positions of pixels less those interpolated between nodes."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask, Single
from zeromethod.fine.lattice import PixelLattice, pixel_line, with_ghosts
from zeromethod.warp.grid import PADDING
from zeromethod.warp.interpolant import sample_pair, window_matched


@numba.njit(cache=True)
def _looked_at(
    drawn: Float,
    per_px: float,
    level: Float,
    row_first: Ints,
    of_rows: Float,
    of_cell: Float,
    share: Single,
    d: Single,
    seen: Mask,
) -> None:
    line, at = np.empty(level.shape[2]), np.empty((2, d.shape[1]))
    for j in range(d.shape[0]):
        for k in range(2):
            pixel_line(level[k], row_first[j], of_rows[j], of_cell, line, at[k])
        for i in range(d.shape[1]):
            col = PADDING + per_px * (i + d[j, i, 0])
            row = PADDING + per_px * (j + d[j, i, 1])
            x, y = sample_pair(drawn, col, row)
            seen[j, i] = seen[j, i] and math.isfinite(x + y)
            d[j, i, 0] = share[j, i] * (x - at[0, i]) if seen[j, i] else 0.0
            d[j, i, 1] = share[j, i] * (y - at[1, i]) if seen[j, i] else 0.0


def pixel_detail(
    lattice: PixelLattice, shown: Float, level: Float, share: Single, d: Single, seen: Mask
) -> None:
    """Make pixels' displacement d (rows, cols, 2), camera px, a share of the detail that they see, LCD px.

    That is their LCD position less that of a level (node rows, node cols, 2) between nodes. Pixels off the
    drawn picture are no longer seen, and what is not seen has none.

    shown: (node rows, node cols, 2) warp whose window-matched interpolant was drawn, with its padding. share,
    seen: (rows, cols).

    Convention: a pixel looks at shown((u, v) + d).
    """
    drawn = np.empty(shown.shape, np.float32)
    window_matched(shown, drawn)
    planes = with_ghosts(np.moveaxis(level, -1, 0))
    per_px = 1.0 / lattice.grid.spacing_px
    _looked_at(drawn.astype(np.float64), per_px, planes, *lattice.between, share, d, seen)
