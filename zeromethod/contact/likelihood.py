"""How likely a grey level is at a distance from a contact's border, whatever the picture's phase there.

Beside a contact the mirror bends more than a picture can follow, so that the phase of what it shows is not
known; how often each grey level occurs in the picture is. Inside, the object scatters one level. Between, the
lens's pupil blurs the border and mixes both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from zeromethod.arrays import Bytes, Float, Single

STEP_PX = 0.25
REACH_PX = 4.0
_LEAST = 1e-5
"""Probability of a grey level that nothing explains."""
LEVELS = 127
UNKNOWN = 127
"""Column of pixels that say nothing: dirt."""


@dataclass(frozen=True, slots=True)
class GreyModel:
    """Log-likelihoods (distances, grey levels): distance -REACH_PX (inside) to REACH_PX by STEP_PX.

    Grey levels, black taken off: `first` + k x `step`, k below LEVELS; the last column, UNKNOWN, is 0.
    `mirrored`: mean grey of the picture; `scattered`: grey level inside. `blur_px`: standard deviation of the
    border's blur.
    """

    table: Single
    first: float
    step: float
    mirrored: float
    scattered: float
    blur_px: float

    def index(self, grey: Single) -> Bytes:
        """Column of the table of each grey level."""
        column = np.clip(np.rint((grey - self.first) / self.step), 0, LEVELS - 1)
        return np.asarray(column, dtype=np.uint8)

    @property
    def light(self) -> Single:
        """(LEVELS + 1,) light of each column over the picture's mean; 0 for UNKNOWN."""
        return np.append((self.first + self.step * np.arange(LEVELS)) / self.mirrored, 0).astype(np.float32)

    @property
    def evidence(self) -> Single:
        """(LEVELS + 1,) log-likelihood of being inside less that of being outside, each at most 4."""
        return np.asarray(np.clip(self.table[0] - self.table[-1], -4, 4), dtype=np.float32)


def grey_model(
    scattered: float,
    mirrored: float,
    levels: Float,
    shares: Float,
    blur_px: float,
    noise: tuple[float, float],
) -> GreyModel:
    """Model of one contact.

    scattered: grey level inside. mirrored: mean grey of the picture around. levels, shares: how often the
    picture has levels times its mean. blur_px: standard deviation of the border's blur. noise: (variance
    without light, variance per grey).
    """
    distance = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    covered = ndtr(-distance / blur_px)[:, None]
    mean = covered * scattered + (1 - covered) * mirrored * levels[None, :]
    top = mirrored * 2.4
    first, step = -0.05 * top, 1.1 * top / (LEVELS - 1)
    grey = first + step * np.arange(LEVELS)
    variance = noise[0] + noise[1] * np.maximum(mean, 0.0) + step**2 / 12
    z = (grey[None, :, None] - mean[:, None, :]) ** 2 / variance[:, None, :]
    density = np.exp(-0.5 * z) / np.sqrt(2 * np.pi * variance)[:, None, :]
    table = np.log(density @ shares + _LEAST)
    table = np.concatenate((table, np.zeros((len(table), 1))), axis=1)
    grey_levels = float(first), float(step), float(mirrored), float(scattered)
    return GreyModel(table.astype(np.float32), *grey_levels, blur_px)
