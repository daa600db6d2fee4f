"""The camera's grey without light, and how straight its grey follows the light, from several exposures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError, MeasurementError


@dataclass(frozen=True)
class BlackLevel:
    """The camera's grey without light.

    source: "dark" (frames in the dark), "exposures", or "bounds": then it lies evenly anywhere from low to
    high, and grey, sigma are the middle and the standard deviation of that.
    """

    grey: float
    sigma: float
    low: float
    high: float
    source: Literal["dark", "exposures", "bounds"]


@dataclass(frozen=True)
class Linearity:
    """Grey against exposure.

    black: at no exposure. departure: largest, from a straight line, over the span of greys; departure_sigma.
    bent: the departure is worth a word.
    """

    black: BlackLevel
    departure: float
    departure_sigma: float
    bent: bool


NOTABLE_DEPARTURE = 0.01
"""From a straight line, over the span of greys, that is worth a word."""


def black_from_exposures(exposure_s: Sequence[float], grey: Float, sigma_grey: float) -> Linearity:
    """Black level and linearity from one picture at several exposures.

    grey: (exposures, regions) mean grey. sigma_grey: standard deviation of one number without the backlight's
    own unsteadiness, which is judged from the misfit. Three exposures at least, which differ twofold; with
    three, a bent line is bent by noise, too. Raises InputError otherwise, MeasurementError where the grey
    does not rise.
    """
    time = np.asarray(exposure_s, dtype=np.float64)
    if time.ndim != 1 or grey.ndim != 2 or len(time) != len(grey) or len(set(time.tolist())) < 3:
        raise InputError(
            f"exposures: {list(exposure_s)}, grey {grey.shape}: three or more, with (exposures, regions)"
        )
    if time.min() <= 0 or time.max() < 2 * time.min():
        raise InputError(f"exposures: {list(exposure_s)} s: above 0, the longest twice the shortest or more")
    # Light differs between regions, black does not: grey = black + light (t + bend t^2), light by the
    # longest.
    share = time / time.max()
    shortest, longest = int(np.argmin(time)), int(np.argmax(time))
    if np.any(grey[longest] - grey[shortest] < 10 * max(sigma_grey, 1e-9)):
        raise MeasurementError(
            "black level: the grey does not rise with the exposure: switch off automatic exposure and gain, "
            "and make sure that the light is on"
        )
    light = grey[longest] - grey[shortest]
    weight = light / np.sum(light**2)
    # projected on the regions' own pattern: one number per exposure; their plain mean would do as well
    flat = (grey @ weight) / float(np.sum(weight))
    straight = np.stack([np.ones_like(share), share], axis=-1)
    bent = np.column_stack([straight, share * (1 - share)])
    sigma = np.full(len(share), max(sigma_grey, 1e-6) / math.sqrt(grey.shape[1]))
    line, line_cov, line_chi2 = _fit(straight, flat, sigma)
    curve, curve_cov, curve_chi2 = _fit(bent, flat, sigma)
    span = float(curve[1])
    # the largest of x (1 - x) is a quarter; taken against the line through none and the longest
    departure = 0.25 * float(curve[2]) / span
    departure_sigma = 0.25 * math.sqrt(curve_cov[2, 2] * max(curve_chi2, 1.0)) / span
    is_bent = abs(departure) > max(4 * departure_sigma, 1e-3)
    terms, cov, chi2 = (curve, curve_cov, curve_chi2) if is_bent else (line, line_cov, line_chi2)
    value, spread = float(terms[0]), math.sqrt(cov[0, 0] * max(chi2, 1.0))
    black = BlackLevel(value, spread, value - 2 * spread, value + 2 * spread, "exposures")
    return Linearity(black, departure, departure_sigma, is_bent and abs(departure) > NOTABLE_DEPARTURE)


def _fit(design: Float, values: Float, sigma: Float) -> tuple[Float, Float, float]:
    weighted = design / sigma[:, None]
    terms = np.linalg.lstsq(weighted, values / sigma, rcond=None)[0]
    covariance = np.linalg.inv(weighted.T @ weighted)
    free = len(values) - design.shape[1]
    chi2 = float(np.sum(((values - design @ terms) / sigma) ** 2)) / free if free else 1.0
    return np.asarray(terms), np.asarray(covariance), float(chi2)
