"""What the sensing window hides of depth as long as the picture is not nulled.

The sensor reads the mean of a residual under its window, so that of what is left to null a part is not seen,
to first order (P^2 - 1) / 12 of its Laplacian (`sensing.window.curvature_bias_px2`): by the same share of its
own Laplacian depth is off, which is the divergence of the slope that is left. Nothing is taken off, as that
would add noise to every reading; it is stated, and next to a node what is there: where the first order
changes its sign, higher ones do not.
"""

from __future__ import annotations

import math

import cv2
import numba
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
        self._step2 = np.ascontiguousarray(step[..., :2] ** 2 + step[..., 2:] ** 2)
        self._per_px = np.einsum("...ai,...ij->...aj", step.reshape(*x_mm.shape, 2, 2), inverse)

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


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _divergence(left: Single, per_px: Float, share: float, island: Mask) -> Float:
    """Share of the divergence (rows, cols) of the slope that is left, mm; 0 where a neighbour lacks it."""
    rows, cols = island.shape
    rise = np.empty((2, rows, cols))
    for i in range(rows):
        for j in range(cols):
            for k in range(2):
                slope = per_px[i, j, k, 0] * left[i, j, 0] + per_px[i, j, k, 1] * left[i, j, 1]
                rise[k, i, j] = slope if island[i, j] else math.nan
    out = np.zeros((rows, cols))
    for i in range(rows):
        for j in range(cols):
            across = rise[0, i, j + 1] - rise[0, i, j - 1] if 0 < j < cols - 1 else math.nan
            down = rise[1, i + 1, j] - rise[1, i - 1, j] if 0 < i < rows - 1 else math.nan
            if island[i, j]:
                out[i, j] += 0.0 if math.isnan(across) else 0.5 * share * across
                out[i, j] += 0.0 if math.isnan(down) else 0.5 * share * down
    return out


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _add_shifted(values: Float, out: Float) -> None:
    """Add values (n,) to those before, at, and after them."""
    n = len(out) - 1
    for k in range(1, n):
        out[k] += values[k - 1] + values[k] + values[k + 1]
    out[0] += values[0] + values[1]
    out[n] += values[n - 1] + values[n]


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _beyond_noise(hidden: Float, step2: Float, variance: Float, least: float, island: Mask) -> Float:
    """The nodes around which the mean over 3 x 3 is more than so many deviations of noise; 0 elsewhere.

    step2: (rows, cols, 2) mm^2 per node of x and y. At least 2 columns.
    """
    rows, cols = island.shape
    out, known = np.zeros((rows, cols)), island.astype(np.float64)
    total, count = np.empty(cols), np.empty(cols)
    for i in range(rows):
        total[:], count[:] = 0.0, 0.0
        for m in range(max(i - 1, 0), min(i + 2, rows)):
            _add_shifted(hidden[m], total)
            _add_shifted(known[m], count)
        of_x, to, own = variance[i], out[i], hidden[i]
        per, there = step2[i], known[i]
        for j in range(cols):
            noise2 = per[j, 0] * of_x[j, 0] + per[j, 1] * of_x[j, 1]
            size = total[j] * total[j] > (count[j] * least) ** 2 * noise2
            # False for nodes off the island, whose variance may be NaN
            to[j] = own[j] if size & (there[j] > 0.0) else 0.0
    return out
