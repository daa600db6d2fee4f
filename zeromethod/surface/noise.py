"""Noise of depth: how independent pixels' noise reaches it by way of overlapping windows and integration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from zeromethod.surface.integrate import SlopeIntegrator

_PROBES = 96
_SMOOTHING_NODES = 1.5
_KEEP_SHARE = 0.05
_KEEP_FACTOR = 1.5
"""Probes are kept while the mask differs on fewer nodes than this share, and as few nodes' noise changed,
relative to all others', by more than this factor."""
_SEED = 20040


def overlap_correlation(period_px: int, spacing_px: int) -> NDArray[np.float64]:
    """Correlation of the noise of two nodes 0, 1, 2, ... apart along one axis.

    The sensing window is a box of one period convolved with itself (a triangle of 2 period - 1 pixels);
    pixels' noise is independent, so the correlation is the window's autocorrelation, a cubic B-spline:
    1, 0.719, 0.25, 0.031, 0 at half a period per node.
    """
    box = np.ones(period_px)
    triangle = np.convolve(box, box)
    whole = np.convolve(triangle, triangle)
    correlation: NDArray[np.float64] = whole[len(whole) // 2 :: spacing_px] / whole[len(whole) // 2]
    return correlation


def correlated_noise(
    count: int, shape: tuple[int, int], correlation: NDArray[np.float64], generator: np.random.Generator
) -> NDArray[np.float64]:
    """Unit-variance noise (count, rows, cols), correlated alike along both axes."""
    margin = len(correlation)
    size = tuple(fft.next_fast_len(n + margin, real=True) for n in shape)
    roots = []
    for n in size:
        line = np.zeros(n)
        line[:margin] = correlation
        line[n - margin + 1 :] = correlation[:0:-1]
        roots.append(np.sqrt(np.maximum(fft.fft(line).real, 0.0)))
    response = roots[0][:, None] * roots[1][None, : size[1] // 2 + 1]
    white = generator.standard_normal((count, *size))
    smooth = fft.irfft2(fft.rfft2(white) * response, s=size)
    result: NDArray[np.float64] = smooth[:, : shape[0], : shape[1]]
    return result


class DepthNoise:
    """Standard deviation of depth by seeded probes through the integrator itself.

    The probes are kept while mask and noise keep their shape; a frame then costs one product with them.
    96 probes know each node's sigma to 7 %, before smoothing.
    """

    def __init__(
        self, integrator: SlopeIntegrator, slope_per_q: NDArray[np.float64], correlation: NDArray[np.float64]
    ) -> None:
        """slope_per_q: (rows, cols, 2, 2), slope in rad per LCD px at rest."""
        self._integrator = integrator
        self._slope_per_q = slope_per_q
        self._correlation = correlation
        self._sigma_q = np.zeros(slope_per_q.shape[:-1])
        self._mask = np.zeros(slope_per_q.shape[:-2], bool)
        self._probes = np.zeros((0, self._mask.size), np.float32)

    def sigma(
        self,
        sigma_q: NDArray[np.float64],
        x_mm: NDArray[np.float64],
        y_mm: NDArray[np.float64],
        weights: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Sigma (rows, cols) of depth / h, in mm, when the `weights`' mean of depth / h is taken as 0.

        sigma_q: (rows, cols, 2) of the warp, LCD px. NaN off the integrator's island.
        """
        island = self._integrator.island
        gain = self._rescaled(sigma_q, island)
        if gain is None:
            self._probe(sigma_q, x_mm, y_mm)
            gain = 1.0
        anchor = np.where(self._mask, weights, 0.0).ravel().astype(np.float32)
        anchor /= max(float(anchor.sum()), 1e-30)
        offsets = self._probes @ anchor
        variance = self._second - 2.0 * (offsets @ self._probes) / len(offsets) + float(np.mean(offsets**2))
        known = ndimage.gaussian_filter(self._mask.astype(np.float64), _SMOOTHING_NODES)
        smooth = ndimage.gaussian_filter(
            np.where(self._mask, variance.reshape(self._mask.shape), 0.0), _SMOOTHING_NODES
        )
        reached = known > 1e-3
        smooth = np.where(reached, smooth / np.where(reached, known, 1.0), smooth.max())
        return np.where(island, gain * np.sqrt(np.maximum(smooth, 0.0)), np.nan)

    def _rescaled(self, sigma_q: NDArray[np.float64], island: NDArray[np.bool_]) -> float | None:
        """Noise now relative to that of the probes; None when they no longer stand for it."""
        both = island & self._mask
        count = np.count_nonzero(island | self._mask)
        if np.count_nonzero(both) < (1.0 - _KEEP_SHARE) * count or not both.any():
            return None
        ratio = sigma_q[both] / self._sigma_q[both]
        gain = float(np.median(ratio))
        off = (ratio > _KEEP_FACTOR * gain) | (ratio < gain / _KEEP_FACTOR)
        return None if np.mean(off) > _KEEP_SHARE else gain

    def _probe(
        self, sigma_q: NDArray[np.float64], x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]
    ) -> None:
        island = self._integrator.island
        generator = np.random.default_rng(_SEED)
        shape = (island.shape[0], island.shape[1])
        sigma = np.where(island[..., None], sigma_q, 0.0)
        per_q = np.where(island[..., None, None], self._slope_per_q, 0.0)
        q = np.stack([correlated_noise(_PROBES, shape, self._correlation, generator) for _ in range(2)], -1)
        slope = np.einsum("...ij,...j->...i", per_q, q * sigma)
        probes = self._integrator.integrate(slope, x_mm, y_mm).reshape(_PROBES, -1)
        probes -= probes[:, island.ravel()].mean(axis=1, keepdims=True)
        probes[:, ~island.ravel()] = 0.0
        self._probes = probes.astype(np.float32)
        self._second = np.mean(self._probes**2, axis=0)
        self._sigma_q, self._mask = sigma.copy(), island.copy()
