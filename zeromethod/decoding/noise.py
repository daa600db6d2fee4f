"""Camera noise: grey variance = a + b grey, given or fitted to the frames' scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from zeromethod.arrays import Float, Image

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole grey levels."""

_CLASSES = 12
"""Classes of brightness in which noise is measured, each with as many pixels."""
_LEAST_PIXELS, _LEAST_RANGE = 50, 2.0
"""Pixels without which there is no model; brightest class over darkest below which noise counts as
constant."""


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Variance of one grey level reading: constant_grey2 + slope_grey x grey, grey as in the frames."""

    constant_grey2: float
    slope_grey: float

    @classmethod
    def of_camera(
        cls, read_grey: float, electrons_per_grey: float | None = None, black_grey: float = 0.0
    ) -> NoiseModel:
        """From read noise (grey levels), gain and black level, as in a rig file; rounding is added."""
        slope = 1.0 / electrons_per_grey if electrons_per_grey else 0.0
        return cls(read_grey**2 + QUANTISATION - slope * black_grey, slope)

    def scaled(self, factor: float) -> NoiseModel:
        """The model with variances times `factor`."""
        return NoiseModel(self.constant_grey2 * factor, self.slope_grey * factor)

    def variance(self, grey: Image | float) -> Float:
        """Variance at a grey level; never below that of rounding."""
        return np.maximum(self.constant_grey2 + self.slope_grey * np.asarray(grey), QUANTISATION)


def fit_noise(mean: Image, scatter: Image, degrees: int) -> NoiseModel | None:
    """Noise model from pixels' mean grey and scatter (residual variance of `degrees` degrees of freedom).

    mean, scatter: (n,). Medians over classes of similar mean and equal size, robust against disturbed
    pixels; neither constant nor slope is below zero. None for too few pixels.
    """
    known = np.isfinite(mean) & np.isfinite(scatter)
    mean, scatter = mean[known].astype(np.float64), scatter[known].astype(np.float64)
    if degrees < 1 or len(mean) < _LEAST_PIXELS:
        return None
    median_share = chdtri(degrees, 0.5) / degrees
    order, size = np.argsort(mean), len(mean) // _CLASSES
    classes = order[: size * _CLASSES].reshape(_CLASSES, size)
    grey = mean[classes[:, size // 2]]
    variance = np.median(scatter[classes], axis=1) / median_share
    overall = float(np.mean(variance))
    # equal relative errors: classes weigh 1 / variance^2; a narrow range of grey gets a constant
    w = 1.0 / np.maximum(variance, QUANTISATION)
    matrix = np.stack([w, w * grey], axis=1)
    (constant, slope), *_ = np.linalg.lstsq(matrix, w * variance, rcond=1e-9)
    if slope <= 0 or grey.max() < _LEAST_RANGE * max(grey.min(), 1e-9):
        return NoiseModel(overall, 0.0)
    if constant < 0:
        return NoiseModel(0.0, overall / float(np.mean(grey)))
    return NoiseModel(float(constant), float(slope))
