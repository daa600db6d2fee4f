"""What single pixels see beyond the nodes: LCD positions of pixels less those interpolated between nodes."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.fine.lattice import PixelLattice
from zeromethod.warp.grid import PADDING
from zeromethod.warp.interpolant import sample, window_matched


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
    field, per_px = drawn.astype(np.float64), 1.0 / lattice.grid.spacing_px
    v, u = (np.arange(size) for size in lattice.shape)
    for rows, between in lattice.bands(np.moveaxis(level, -1, 0)):
        col = PADDING + per_px * (u + d[rows, :, 0])
        row = PADDING + per_px * (v[rows, None] + d[rows, :, 1])
        q = sample(field, col, row)
        seen[rows] &= np.isfinite(q[..., 0] + q[..., 1])
        for k in range(2):
            away = share[rows] * (q[..., k] - between[:, k])
            d[rows, :, k] = np.where(seen[rows], away, 0.0)
