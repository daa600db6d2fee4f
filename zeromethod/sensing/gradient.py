"""Displacement against a target without a carrier (noise): one Gauss-Newton step per node, near null only.

In each window grey = gain (T + du T_u + dv T_v) + offset is fitted by weighted least squares (Lucas and
Kanade 1981, with brightness and contrast free as in Gennert and Negahdaripour 1987). The normal
matrices belong to the target and are inverted once; an image costs four window sums.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from zeromethod.arrays import Float, Image, Single
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import clipped_pixels
from zeromethod.sensing.residual import Limits, Residual, Scales, flags_of
from zeromethod.sensing.window import sums_along, triangle
from zeromethod.warp.grid import INNER, PADDING, NodeGrid
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
        self._basis = basis.astype(np.float32)
        self._weights = np.concatenate([[0.0], triangle(period)]).astype(np.float32)[None]
        self._scales = Scales.of(noise, limits, period)
        self._mean, self._farthest_px = mean, period / 4
        self._ceiling, self._half = ceiling, half

    def estimate(self, image: Image, reference_light: Single, out: Residual) -> None:
        """Fill the measurable nodes of `out`; reference light as for `CarrierEstimator.estimate`."""
        sums = self._window_sums(image)
        gain, moved_u, moved_v, offset = np.einsum("rcij,jrc->irc", self._inverse, sums)
        fits = gain > 0
        black, per_grey = self._scales.black, self._scales.per_grey
        pixel = self._scales.still + per_grey * np.maximum(offset - black, 0.0)
        still, by_light = np.moveaxis(self._spread, (2, 3), (1, 0))
        variance = pixel * still + per_grey * gain * by_light
        with np.errstate(divide="ignore", invalid="ignore"):
            d = np.where(fits, np.stack([moved_u, moved_v]) / gain, 0.0)
            sigma = np.where(fits, np.sqrt(np.maximum(variance, 0.0)) / gain, np.inf)
        amplitude = np.maximum(gain, 0.0) * self._rms * np.sqrt(2.0)
        out.d[INNER], out.sigma[INNER] = np.moveaxis(d, 0, -1), np.moveaxis(sigma, 0, -1)
        out.modulation[INNER], out.mean[INNER] = amplitude[..., None], sums[3]
        over = clipped_pixels(image, self._ceiling, gain.shape, self._half)
        flags = flags_of(np.maximum(*sigma), amplitude, sums[3] - black, reference_light, over, self._scales)
        far = np.abs(d).max(axis=0) > self._farthest_px
        flags[far | (gain * self._mean < LEAST_MATCH * (offset - black))] |= np.uint16(AMBIGUOUS)
        out.flags[INNER] = flags

    def _window_sums(self, image: Image) -> Single:
        """(4, rows, cols) window sums of grey x (target, its two gradients, one)."""
        height, width = self._basis.shape[1:]
        products = self._basis * image[:height, :width]
        across = sums_along(products, self._weights)[0]
        return np.asarray(sums_along(across.swapaxes(1, 2), self._weights)[0].swapaxes(1, 2))


def _window_matrix(nodes: int, period: int) -> csr_array:
    """(nodes, pixels) window weights of every node along one axis."""
    pixel = period + period // 2 * np.arange(nodes)[:, None] + np.arange(1 - period, period)
    weight = np.broadcast_to(triangle(period), pixel.shape)
    start = np.arange(nodes + 1) * pixel.shape[1]
    return csr_array((weight.ravel(), pixel.ravel(), start), shape=(nodes, period // 2 * (nodes + 3)))
