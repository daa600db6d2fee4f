"""Displacement against a target without a carrier (noise): one Gauss-Newton step per node, near null only.

In each window grey = gain (T + du T_u + dv T_v) + offset is fitted by weighted least squares (Lucas and
Kanade 1981, with brightness and contrast free as in Gennert and Negahdaripour 1987). The normal
matrices belong to the target and are inverted once; an image costs four window sums.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from zeromethod.arrays import Flags, Float, Single
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import FAST, Buffers, Image, count_clipped, window_rows
from zeromethod.sensing.residual import Limits, Residual, Scales, flags_of
from zeromethod.sensing.window import triangle
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.validity import Flag

AMBIGUOUS = int(Flag.AMBIGUOUS)
LEAST_MATCH = 0.4
"""Least contrast relative to the target's; below, another part of the target is assumed."""

Light = Callable[[Float, Float], Float]
"""The target's light at camera pixels (u, v)."""


class GradientEstimator:
    """Estimator of the displacement near null of an image (rows, cols) against a target without a period.

    Trusted up to a quarter of the grid's period; beyond, or where the contrast does not match, a node is
    AMBIGUOUS: no unwrapping. Modulation is that of a cosine with the pattern's rms.
    """

    def __init__(self, grid: NodeGrid, noise: Noise, ceiling: int, limits: Limits, light: Light) -> None:
        rows, cols = (n - 2 * PADDING for n in grid.shape)
        period, half = grid.period_px, grid.period_px // 2
        v, u = np.mgrid[: half * (rows + 3), : half * (cols + 3)].astype(float)
        target = light(u, v)
        mean = float(target.mean())
        step = 1e-3
        # basis of the fit: target about its mean, its two gradients (per px), one
        basis = np.stack(
            [
                target - mean,
                (light(u + step, v) - light(u - step, v)) / (2 * step),
                (light(u, v + step) - light(u, v - step)) / (2 * step),
                np.ones_like(target),
            ]
        )
        down, across = (_window_matrix(n, period) for n in (rows, cols))
        down2, across2 = down.power(2), across.power(2)
        normal, white, shot = (np.empty((rows, cols, 4, 4)) for _ in range(3))
        for i in range(4):
            for j in range(4):
                product = basis[i] * basis[j]
                normal[..., i, j] = down @ product @ across.T
                white[..., i, j] = down2 @ product @ across2.T
                shot[..., i, j] = down2 @ (product * basis[0]) @ across2.T
        self._inverse: Float = np.linalg.inv(normal).astype(np.float64)
        self._spread = np.stack(
            [
                np.diagonal(self._inverse @ q @ self._inverse, axis1=-2, axis2=-1)[..., 1:3]
                for q in (white, shot)
            ],
            axis=-1,
        )
        self._rms: Float = np.sqrt(np.maximum(normal[..., 0, 0] - normal[..., 0, 3] ** 2, 0.0))
        self._basis = basis[:3].astype(np.float32)
        self._scales = Scales.of(noise, limits, period)
        self._mean, self._farthest_px = mean, period / 4
        self._ceiling = ceiling
        self._buffers = Buffers.of((rows, cols), period, signs=(1, 1, 1, 1), planes=4)

    def estimate(self, image: Image, reference_light: Single, out: Residual) -> None:
        """Fill the measurable nodes of `out`; reference light as for `CarrierEstimator.estimate`."""
        buffers, fit = self._buffers, (self._inverse, self._spread, self._rms, self._mean, self._farthest_px)
        _project(image, self._ceiling, self._basis, buffers)
        _solve(buffers.planes, buffers.clipped, *fit, self._scales, reference_light, out.arrays)


def _window_matrix(nodes: int, period: int) -> csr_array:
    """(nodes, pixels) window weights of every node along one axis."""
    pixel = period + period // 2 * np.arange(nodes)[:, None] + np.arange(1 - period, period)
    weight = np.broadcast_to(triangle(period), pixel.shape)
    start = np.arange(nodes + 1) * pixel.shape[1]
    return csr_array((weight.ravel(), pixel.ravel(), start), shape=(nodes, period // 2 * (nodes + 3)))


@numba.njit(cache=True, fastmath=FAST)
def _project(image: Image, ceiling: int, basis: Single, buffers: Buffers) -> None:
    """Window sums of grey x (target, its gradients, one) per node, in `planes`."""
    window, blocks, signs, rows = buffers.window, buffers.blocks, buffers.signs, buffers.rows
    taps, peak, planes, clipped = buffers.taps[0], buffers.peak, buffers.planes, buffers.clipped
    half, zero = len(window) // 4, np.float32(0)
    for b in range(clipped.shape[0]):
        sums = blocks[b & 3]
        sums[:] = zero
        peak[:] = 0
        for y in range(half):
            row = b * half + y
            line, at = image[row], np.float32(y)
            t, tu, tv = basis[0, row], basis[1, row], basis[2, row]
            for u in range(sums.shape[1]):
                peak[u] = max(peak[u], line[u])
                grey = np.float32(line[u])
                p, q, s = grey * t[u], grey * tu[u], grey * tv[u]
                sums[0, u] += p
                sums[1, u] += at * p
                sums[2, u] += q
                sums[3, u] += at * q
                sums[4, u] += s
                sums[5, u] += at * s
                sums[6, u] += grey
                sums[7, u] += at * grey
        count_clipped(image, b * half, half, ceiling, peak, clipped[b])
        if b < 3:
            continue
        r = b - 3
        window_rows(blocks[r & 3], blocks[(r + 1) & 3], blocks[(r + 2) & 3], sums, signs, half, rows)
        for j in range(planes.shape[2]):
            a0, a1, a2, a3 = zero, zero, zero, zero
            for k in range(len(window)):
                weight = taps[k]
                a0 += weight * rows[0, half * j + k]
                a1 += weight * rows[1, half * j + k]
                a2 += weight * rows[2, half * j + k]
                a3 += weight * rows[3, half * j + k]
            planes[0, r, j], planes[1, r, j], planes[2, r, j], planes[3, r, j] = a0, a1, a2, a3


@numba.njit(cache=True)
def _solve(
    planes: Single,
    clipped: NDArray[np.int32],
    inverse: Float,
    spread: Float,
    rms: Float,
    target_mean: float,
    farthest_px: float,
    scales: Scales,
    reference_light: Single,
    out: tuple[Float, Float, Flags, Single, Single],
) -> None:
    d, sigma, flags, modulation, mean = out
    still, per_grey, black = scales.still, scales.per_grey, scales.black
    for r in range(planes.shape[1]):
        for j in range(planes.shape[2]):
            row, col, m = r + PADDING, j + PADDING, inverse[r, j]
            p, q, s, t = planes[0, r, j], planes[1, r, j], planes[2, r, j], planes[3, r, j]
            gain = m[0, 0] * p + m[0, 1] * q + m[0, 2] * s + m[0, 3] * t
            offset = m[3, 0] * p + m[3, 1] * q + m[3, 2] * s + m[3, 3] * t
            light = t - black
            pixel = still + per_grey * max(offset - black, 0.0)
            amplitude = max(gain, 0.0) * rms[r, j] * np.sqrt(2.0)
            far = 0.0
            for k in range(2):
                if gain > 0:
                    n = m[k + 1]
                    moved = (n[0] * p + n[1] * q + n[2] * s + n[3] * t) / gain
                    variance = pixel * spread[r, j, k, 0] + per_grey * gain * spread[r, j, k, 1]
                    far = max(far, abs(moved))
                    d[row, col, k] = moved
                    sigma[row, col, k] = np.sqrt(max(variance, 0.0)) / gain
                else:
                    d[row, col, k], sigma[row, col, k] = 0.0, np.inf
                modulation[row, col, k] = amplitude
            worst = max(sigma[row, col, 0], sigma[row, col, 1])
            over = clipped[r : r + 4, j : j + 4].sum()
            flag = flags_of(worst, amplitude, light, reference_light[r, j], over, scales)
            if far > farthest_px or gain * target_mean < LEAST_MATCH * (offset - black):
                flag |= AMBIGUOUS
            mean[row, col] = t
            flags[row, col] = flag
