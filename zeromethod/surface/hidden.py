"""What the sensing window hides of depth as long as the picture is not nulled.

The sensor reads the mean of a residual under its window, so that of what is left to null a part is not seen,
to first order (P^2 - 1) / 12 of its Laplacian (`sensing.window.curvature_bias_px2`): by the same share of its
own Laplacian depth is off, which is the divergence of the slope that is left. Nothing is taken off, as that
would add noise to every reading; it is stated, and next to a node what is there: where the first order
changes its sign, higher ones do not.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.sensing.window import curvature_bias_px2
from zeromethod.warp.grid import NodeGrid

_NOISE = 0.36
"""Standard deviation of a component's central difference, mean over 3 x 3 nodes, over that of one node: by
the correlation of overlapping windows (`zeromethod.warp.overlap`)."""

_NOISES = 4.5
"""Standard deviations of noise up to which nothing is stated: one node of 20,000 passes it in 7 frames."""

_AROUND = 5
"""Nodes on a side of the square over which the rms is stated, where a node's own is less."""


class HiddenDepth:
    """Depth that the window hides, of one lattice. Nothing where the picture is nulled."""

    def __init__(self, grid: NodeGrid, sensitivity: Float, x_mm: Float, y_mm: Float) -> None:
        """sensitivity: (rows, cols, 2, 2) LCD px per rad; x_mm, y_mm: (rows, cols) mirror points; at rest."""
        self._share = curvature_bias_px2(grid.period_px) / grid.spacing_px**2
        self._inner = grid.inner
        step = np.stack([np.gradient(one, axis=axis) for axis in (1, 0) for one in (x_mm, y_mm)], axis=-1)
        # mm of depth per node and LCD px: along columns, along rows
        inverse = np.linalg.inv(sensitivity)
        self._step2 = np.moveaxis(step[..., :2] ** 2 + step[..., 2:] ** 2, -1, 0).copy()
        per_px = np.einsum("...ai,...ij->...aj", step.reshape(*x_mm.shape, 2, 2), inverse)
        self._per_px = np.moveaxis(per_px, (-2, -1), (0, 1)).copy()

    def of(self, left: Single, variance: Float, island: Mask) -> Float | None:
        """Size of that depth (rows, cols) mm, 0 where it may be noise; None where it is nowhere more.

        left: (rows, cols, 2) LCD px of a warp on the whole grid. variance: (rows, cols, 2) rad^2 of slope.
        """
        hidden = _divergence(left[self._inner], self._per_px, self._share, island)
        found = _beyond_noise(hidden, self._step2, variance, _NOISES * _NOISE * self._share, island)
        if not found.any():
            return None
        around2 = cv2.blur(found**2, (_AROUND, _AROUND), borderType=cv2.BORDER_REPLICATE)
        # a running sum may fall below 0 by rounding
        return np.asarray(np.sqrt(np.maximum(found**2, around2)) * island, np.float64)


def _divergence(left: Single, per_px: Float, share: float, island: Mask) -> Float:
    """Share of the divergence (rows, cols) of the slope that is left, mm; 0 where a neighbour lacks it.

    per_px: (2, 2, rows, cols) mm of depth per node along columns and rows, by LCD px of both components.
    """
    x, y = left[..., 0].astype(np.float64), left[..., 1].astype(np.float64)
    x[~island] = np.nan
    along, across = (per_px[k, 0] * x + per_px[k, 1] * y for k in (0, 1))
    across_columns, down_rows = along[:, 2:] - along[:, :-2], across[2:] - across[:-2]
    out = np.zeros(island.shape)
    out[:, 1:-1] = np.where(np.isnan(across_columns), 0.0, across_columns)
    out[1:-1] += np.where(np.isnan(down_rows), 0.0, down_rows)
    out *= 0.5 * share * island
    return out


def _beyond_noise(hidden: Float, step2: Float, variance: Float, least: float, island: Mask) -> Float:
    """The nodes around which the mean over 3 x 3 is more than so many deviations of noise; 0 elsewhere.

    step2: (2, rows, cols) mm^2 per node of x and y.
    """
    total, count = (
        cv2.boxFilter(one, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for one in (hidden, island.astype(np.float64))
    )
    noise2 = step2[0] * variance[..., 0] + step2[1] * variance[..., 1]
    # False for nodes off the island, whose variance may be NaN
    return np.where(island & (total * total > (count * least) ** 2 * noise2), hidden, 0.0)
