"""What a residual that is not yet nulled hides: the sensing window's mean of it is seen in its place.

The mean over a window differs from the value in its middle by a constant times the Laplacian, which
vanishes with the residual itself. Until then readings go without it, and as much is in sigma, for what is of
higher order. It is alike over several nodes and so does not average out as noise does: as much as the area
over which it is alike exceeds that of one window.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.overlap import overlap_correlation, shared_nodes
from zeromethod.warp.warp import Warp

_SIGMAS, _SURELY = 3.0, 5.0
"""Bends of the residual below this many of their sigma are its noise, which sigma has already; one beyond the
second must be there, or the frame counts as nulled."""


@numba.njit(cache=True, error_model="numpy")
def _bends(d: Float, sigma: Float, valid: Mask, noise: Float, out: Float) -> float:
    """Laplacian (rows, cols, 2) of d per node^2, 0 where noise explains it; its sum of squares, 0 if nulled.

    noise: variance of a bend along one axis and along both, over that of d.
    """
    rows, cols = valid.shape
    total = 0.0
    nulled = True
    for j in range(rows):
        for i in range(cols):
            across = 0 < i < cols - 1 and valid[j, i - 1] and valid[j, i + 1]
            down = 0 < j < rows - 1 and valid[j - 1, i] and valid[j + 1, i]
            for k in range(2):
                out[j, i, k] = bend = 0.0
                if not (valid[j, i] and (across or down)):
                    continue
                if across:
                    bend += d[j, i - 1, k] + d[j, i + 1, k] - 2.0 * d[j, i, k]
                if down:
                    bend += d[j - 1, i, k] + d[j + 1, i, k] - 2.0 * d[j, i, k]
                over = bend * bend / (noise[int(across and down)] * sigma[j, i, k] ** 2)
                if over > _SIGMAS**2:
                    out[j, i, k] = bend
                    total += bend * bend
                    nulled = nulled and over <= _SURELY**2
    return 0.0 if nulled else total


@cache
def _window(period_px: int, spacing_px: int) -> tuple[Float, float]:
    """(2,) variance of a bend along one axis and along both, over a node's; nodes that share a window."""
    correlation = overlap_correlation(period_px, spacing_px)
    next_, second = correlation[1], correlation[2]
    one = 6.0 - 8.0 * next_ + 2.0 * second
    # Both axes share the node in the middle; neighbours on different axes are one apart along each.
    shared = 4.0 - 8.0 * next_ + 4.0 * next_**2
    return np.array([one, 2.0 * one + 2.0 * shared]), shared_nodes(correlation)


def _alike_nodes(field: Float, squares: float) -> float:
    """Area in nodes over which a field (rows, cols, 2) is alike: of a Gaussian correlation of its slope."""
    steps = float(np.sum(np.diff(field, axis=0) ** 2) + np.sum(np.diff(field, axis=1) ** 2))
    return 4.0 * math.pi * squares / steps


@numba.njit(cache=True, error_model="numpy")
def _take_out(q: Float, sigma: Float, shown: Float, hidden: Float, alike: float) -> None:
    """Take what is hidden, camera px per node of the lattice of `shown`, out of q, and put it into sigma."""
    rows, cols = shown.shape[0], shown.shape[1]
    for j in range(rows):
        j0, j1 = max(j - 1, 0), min(j + 1, rows - 1)
        for i in range(cols):
            u, v = hidden[j, i, 0], hidden[j, i, 1]
            if u == 0.0 and v == 0.0:
                continue
            i0, i1 = max(i - 1, 0), min(i + 1, cols - 1)
            for k in range(2):
                across = u * (shown[j, i1, k] - shown[j, i0, k]) / (i1 - i0)
                down = v * (shown[j1, i, k] - shown[j0, i, k]) / (j1 - j0)
                q[j, i, k] -= across + down
                sigma[j, i, k] = math.sqrt(sigma[j, i, k] ** 2 + alike**2 * (across**2 + down**2))


def without_unnulled(
    measured: Warp, residual: Residual, shown_q: Float, grid: NodeGrid, bias_px2: float
) -> Warp:
    """The measured warp without what its residual hides, which is in sigma instead.

    shown_q: (rows, cols, 2) LCD px, of the warp that was shown. bias_px2: of the sensor, per Laplacian.
    """
    if bias_px2 == 0.0:
        return measured
    bends = np.empty_like(residual.d)
    noise, window = _window(grid.period_px, grid.spacing_px)
    squares = _bends(residual.d, residual.sigma, measured.valid, noise, bends)
    if not squares > 0.0:
        return measured
    alike = math.sqrt(max(_alike_nodes(bends, squares) / window, 1.0))
    q, sigma = measured.q.copy(), measured.sigma.copy()
    # In nodes, as the differences of what was shown are.
    bends *= bias_px2 / grid.spacing_px**3
    _take_out(q, sigma, shown_q, bends, alike)
    return replace(measured, q=q, sigma=sigma)
