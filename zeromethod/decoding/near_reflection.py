"""Near second reflections: too near for the periods to disagree in one pixel, found over wide areas.

A second place of share s at distance D turns the phase of wave number k = 2 pi / P by

    arg(1 + s exp(i k D)) = s / (1 + s) k D - s (1 - s) / (6 (1 + s)^3) (k D)^3 + ...

The first term moves the place equally for all periods; the second one separates the periods as k^2, with one
sign. Noise averages out over an area. Only s D^3 is found, not s and D; coma of the lens has the same effect.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.decoding.decoding import Phasors
from zeromethod.decoding.periods import LONGEST_RATIO
from zeromethod.decoding.unwrapping import Places

USUAL_SHARE = 0.1
"""Light of a second reflection over the main one's, for which its distance is given."""

AREA_PX = 33
"""Side of the square that is averaged over."""

_SIGMAS = 6.0
"""Standard deviations of the mean over an area from which on a reflection is seen."""
_LEAST_FILLED = 0.5
"""Share of an area's pixels that must be known for it to be judged."""
_WIDE = 0.05
"""Share of the areas that may show more than the result."""


def near_reflection(phasors: Phasors, places: list[Places], usable: Mask) -> float:
    """Distance, LCD px, of a second reflection of `USUAL_SHARE` that explains the periods' disagreement.

    0 where it is within six standard deviations of noise. Places are moved by about `USUAL_SHARE` times it.
    The larger of both axes, over all but the worst twentieth of the view. Valid up to about 6 px.
    """
    return max(_distance(phasors, axis, place, usable) for axis, place in enumerate(places))


def _distance(phasors: Phasors, axis: int, place: Places, usable: Mask) -> float:
    periods = np.asarray(phasors.sequence.periods[axis], dtype=np.float64)
    # coarse periods show no reflection, but whatever else is off in them
    fine = [n for n, period in enumerate(periods) if period <= LONGEST_RATIO * periods.min()]
    usable = usable & np.isfinite(place.x_px)
    if not usable.any() or len(fine) < 2:
        return 0.0
    waves = 2.0 * np.pi / periods[fine]
    x = np.where(usable, place.x_px, 0.0)
    power = np.array([np.median(phasors.power(axis, n)[usable]) for n in fine], dtype=np.float64)
    rest = np.empty((len(waves), *x.shape))
    for m, (n, k) in enumerate(zip(fine, waves, strict=True)):
        phase = np.arctan2(phasors.sine[axis][n], phasors.cosine[axis][n]) - k * x
        rest[m] = (phase - 2.0 * np.pi * np.rint(phase / (2.0 * np.pi))) / k
    weight = np.sqrt(power) * waves
    design = np.stack([np.ones_like(waves), -(waves**2)], axis=-1)
    solve = np.linalg.pinv(design * weight[:, None])[1] * weight
    cubic = np.where(usable, np.tensordot(solve, rest, axes=1), 0.0)

    def pooled(values: Float) -> Float:
        return np.asarray(cv2.boxFilter(values, -1, (AREA_PX,) * 2, borderType=cv2.BORDER_CONSTANT))

    filled = pooled(usable.astype(np.float64))
    full = filled >= _LEAST_FILLED
    if not full.any():
        return 0.0
    middle = float(np.median(cubic[usable]))
    # robust against a tenth of a percent of wrong orders
    scatter = 1.4826 * float(np.median(np.abs(cubic[usable] - middle)))
    mean = pooled(np.where(usable, np.clip(cubic, middle - 5 * scatter, middle + 5 * scatter), 0.0))
    mean = np.abs(mean[full] / filled[full])
    sure = mean > _SIGMAS * scatter / np.sqrt(filled[full] * AREA_PX**2)
    strength = float(np.quantile(np.where(sure, mean, 0.0), 1.0 - _WIDE))
    shape = USUAL_SHARE * (1.0 - USUAL_SHARE) / (6.0 * (1.0 + USUAL_SHARE) ** 3)
    return float(np.cbrt(strength / shape))
