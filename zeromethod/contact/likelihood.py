"""How likely a grey level is inside a contact and beside it, whatever the picture's phase there.

Beside a contact the mirror bends more than a picture can follow, so that the phase of what it shows is not
known; how often each grey level occurs in the picture is. Inside, the object scatters one level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Bytes, Float, Single

_LEAST = 1e-5
"""Probability of a grey level that nothing explains."""
LEVELS = 127
UNKNOWN = 127
"""Column of pixels that say nothing: dirt."""


@dataclass(frozen=True, slots=True)
class GreyModel:
    """What grey levels, black taken off, say of one contact.

    evidence: (LEVELS + 1,) log-likelihood of being inside less that of being outside, each at most 4, for
    grey levels `first` + k x `step`; 0 for UNKNOWN. `mirrored`: mean grey of the picture; `scattered`: grey
    level inside. `blur_px`: standard deviation of the border's blur. noise: (variance without light, variance
    per grey).
    """

    evidence: Single
    first: float
    step: float
    mirrored: float
    scattered: float
    blur_px: float
    noise: tuple[float, float]

    def index(self, grey: Single) -> Bytes:
        """Column of the table of each grey level."""
        column = np.clip(np.rint((grey - self.first) / self.step), 0, LEVELS - 1)
        return np.asarray(column, dtype=np.uint8)

    @property
    def light(self) -> Single:
        """(LEVELS + 1,) light of each column over the picture's mean; 0 for UNKNOWN."""
        return np.append((self.first + self.step * np.arange(LEVELS)) / self.mirrored, 0).astype(np.float32)

    @property
    def scattered_share(self) -> float:
        """Level inside over the picture's mean, to a two-hundredth."""
        return round(200 * self.scattered / self.mirrored) / 200

    @property
    def relative_noise(self) -> tuple[float, float]:
        """The noise of levels over the picture's mean, for that to two digits."""
        mean = float(f"{self.mirrored:.2g}")
        return self.noise[0] / mean**2, self.noise[1] / mean


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
    top = mirrored * 2.4
    first, step = -0.05 * top, 1.1 * top / (LEVELS - 1)
    grey = np.asarray(first + step * np.arange(LEVELS), np.float64)
    inside = _density(grey, np.array([scattered]), noise, step)[:, 0]
    outside = _density(grey, mirrored * levels, noise, step) @ shares
    evidence = np.clip(np.log(inside + _LEAST) - np.log(outside + _LEAST), -4, 4)
    grey_levels = float(first), float(step), float(mirrored), float(scattered)
    return GreyModel(np.append(evidence, 0).astype(np.float32), *grey_levels, blur_px, noise)


def _density(grey: Float, mean: Float, noise: tuple[float, float], step: float) -> Float:
    """(grey levels, means) probability densities of a grey level where so much is meant."""
    variance = noise[0] + noise[1] * np.maximum(mean, 0.0) + step**2 / 12
    return np.asarray(np.exp(-0.5 * (grey[:, None] - mean) ** 2 / variance) / np.sqrt(2 * np.pi * variance))
