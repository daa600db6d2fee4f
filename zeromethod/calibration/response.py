"""The LCD's response: light at the camera for each grey code, per region and so per viewing angle.

Measured by evenly lit pictures, each code in two or more passes (up, then down). Light is counted above the
black LCD's and over the white one's, as `[display] response_light` and `gamma` have it: 0 at code 0, 1 at
code 255. What the black LCD lets through, and room light, are thereby left out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import isotonic_regression, least_squares

from zeromethod.arrays import Float, Image, Ints
from zeromethod.errors import InputError, MeasurementError
from zeromethod.pattern.response import Response

RAMP_CODES = tuple(range(0, 256, 15))
"""Codes of the ramp. A monotone cubic through them is within 7e-4 of the light of power laws
(gamma 1.6 to 2.8) and S-curves: a sixth of what a code of 8 bits is worth."""

TABLE_CODES = tuple(range(0, 256, 5))
"""Codes of the rig file's table, which is read with straight pieces between: 1e-4 of the light."""

LEAST_SWING_SIGMAS = 30.0
"""White less black, over its standard deviation, below which there is no response to speak of."""

NOTABLE_DRIFT = 0.01
"""Per minute, relative."""

NOTABLE_BEND = 0.01
"""Of the white's light, that may lie unseen between codes."""

_LIKELIHOOD_ROUNDS = 200

_LEAST_STEP = 1e-6
"""Between the light of neighbouring codes in a rig file, where every one must lie above the last."""


@dataclass(frozen=True)
class Curve:
    """Light of the measured codes in one region, or in the whole view.

    light, sigma: (n,), 0 and 1 at the ends, which are so by definition: sigma is 0 there. gamma, gamma_sigma:
    of the best power law. misfit: largest departure from it.
    """

    light: Float
    sigma: Float
    gamma: float
    gamma_sigma: float
    misfit: float


@dataclass(frozen=True)
class MeasuredResponse:
    """Response of the LCD as the camera sees it.

    codes: (n,) 0..255. whole: of the lit view. tiles: (tile rows, tile cols) of curves, None where too little
    is lit. drift_per_minute: relative change of the LCD's light, taken out; drift_sigma. falling: codes
    whose light was below that of the code before by more than noise. swing_grey: white less black.
    """

    codes: Ints
    whole: Curve
    tiles: Image
    drift_per_minute: float
    drift_sigma: float
    falling: tuple[int, ...]
    swing_grey: float

    def spread(self, exponents: Float | None = None) -> Float:
        """(n,) largest departure of a region's light from the whole's, less what noise explains, in light.

        This is what one inverse for the whole picture leaves, by viewing angle; with `exponents` (tile rows,
        tile cols) what is left where each region's light is taken for whole^exponent.
        """
        apart, noise = [], []
        for index, curve in np.ndenumerate(self.tiles):
            if curve is not None:
                power = 1.0 if exponents is None else exponents[index]
                apart.append(np.abs(curve.light - self.whole.light**power))
                noise.append(np.hypot(curve.sigma, self.whole.sigma))
        # the largest of some tens of regions lies 2.5 standard deviations out by noise alone
        return np.asarray(np.max(np.maximum(np.array(apart) - 2.5 * np.array(noise), 0.0), axis=0))

    @property
    def between(self) -> float:
        """Departure from the table, in light, that may hide between the codes, as far as it is no noise.

        Every second code is predicted from the rest; at half the distance a smooth curve departs by a quarter
        of that at most, and one with a kink by half.
        """
        light, sigma = self.whole.light, self.whole.sigma
        kept = np.union1d(np.arange(0, len(light), 2), [len(light) - 1])
        left = np.setdiff1d(np.arange(len(light)), kept)
        missed = np.abs(_smooth(self.codes[kept], light[kept], self.codes[left]) - light[left])
        noise = 3.0 * np.hypot(sigma[left], np.sqrt(0.5 * (sigma[left - 1] ** 2 + sigma[left + 1] ** 2)))
        return 0.5 * float(np.max(np.maximum(missed - noise, 0.0)))

    @property
    def notes(self) -> tuple[str, ...]:
        """What should be seen to; empty where all is well."""
        said = []
        if self.between > NOTABLE_BEND:
            said.append(
                f"the light bends so sharply that up to {100 * self.between:.1f} % of the white's may lie "
                "unseen between the codes shown: set the LCD's picture mode to standard"
            )
        drift = abs(self.drift_per_minute)
        if drift > max(NOTABLE_DRIFT, 5 * self.drift_sigma):
            said.append(f"the light changes by {100 * drift:.1f} % per minute: let the LCD warm up")
        if self.falling:
            codes = ", ".join(str(code) for code in self.falling)
            said.append(f"the light falls at codes {codes}: set the LCD's picture mode to standard")
        return tuple(said)

    def table(self) -> tuple[float, ...]:
        """Light at `TABLE_CODES`, each above the last, as a rig file takes it.

        Between the measured codes by a monotone cubic (Fritsch and Butland 1984, doi:10.1137/0905021).
        """
        light = _smooth(self.codes, self.whole.light, np.array(TABLE_CODES))
        return tuple(float(value) for value in _rising(light))

    def response(self) -> Response:
        """What the drawing inverts."""
        return Response(light_of_code=self.table())

    def rig_values(self) -> dict[str, float | list[float]]:
        """Key and value for `save_values`."""
        return {"display.response_light": list(self.table())}


def measure_response(
    codes: Sequence[int], grey: Float, times_s: Float, weights: Float | None = None
) -> MeasuredResponse:
    """Response from the mean grey of evenly lit pictures.

    codes: (n,) rising, from 0 to 255. grey: (passes, n, tile rows, tile cols) of each picture, NaN in tiles
    that do not count; its noise is judged from how passes differ, so two at least. times_s: (passes, n) when
    each was taken. weights: (tile rows, tile cols) of tiles in the whole, e.g. lit pixels.

    Raises InputError for arrays that do not fit, MeasurementError where the light does not follow the codes.
    """
    code = np.asarray(codes, dtype=np.int64)
    _checked(code, grey, times_s)
    seen = np.isfinite(grey).all(axis=(0, 1))
    if not seen.any():
        raise MeasurementError("response: no region of the view follows the LCD")
    weight = np.where(seen, 1.0 if weights is None else weights, 0.0)
    whole = np.einsum("pnij,ij->pn", np.where(seen, grey, 0.0), weight) / weight.sum()
    minutes = (times_s - times_s.mean()) / 60.0
    drift, drift_sigma = _drift(whole, minutes)
    steady = 1.0 + drift * minutes
    # room light and the camera's black do not drift with the backlight
    dark = whole[:, 0].mean()
    curve, swing = _curve(code, (whole - dark) / steady + dark)
    raw = whole.mean(axis=0)
    step_sigma = np.hypot(curve.sigma[1:], curve.sigma[:-1]) * swing
    falling = code[1:][np.diff(raw) < -5.0 * np.maximum(step_sigma, 1e-9 * swing)]
    tiles = np.full(seen.shape, None, dtype=object)
    for place in np.argwhere(seen):
        mine = grey[:, :, place[0], place[1]]
        dark = mine[:, 0].mean()
        tiles[tuple(place)] = _curve(code, (mine - dark) / steady + dark)[0]
    return MeasuredResponse(code, curve, tiles, drift, drift_sigma, tuple(falling.tolist()), swing)


def _checked(code: Ints, grey: Float, times_s: Float) -> None:
    if len(code) < 4 or code[0] != 0 or code[-1] != 255 or np.any(np.diff(code) <= 0):
        raise InputError(f"codes: {code.tolist()}: four or more, rising, from 0 to 255")
    if grey.ndim != 4 or len(grey) < 2 or grey.shape[1] != len(code) or times_s.shape != grey.shape[:2]:
        raise InputError(
            f"grey: shape {grey.shape}, times {times_s.shape}: (two or more passes, {len(code)} codes, tile "
            "rows, tile cols), and the first two of these"
        )


def _drift(whole: Float, minutes: Float) -> tuple[float, float]:
    """Relative change per minute of the light above black, by how passes differ; its standard deviation."""
    light = whole - whole[:, :1].mean()
    mean = light.mean(axis=0)
    apart = light - mean
    lever = mean * (minutes - minutes.mean(axis=0))
    weight = float(np.sum(lever**2))
    if weight <= 0:
        return 0.0, float("inf")
    drift = float(np.sum(lever * apart)) / weight
    rest = apart - drift * lever
    degrees = max(rest.size - rest.shape[1] - 1, 1)
    return drift, float(np.sqrt(np.sum(rest**2) / degrees / weight))


def _variance(grey: Float) -> Float:
    """(n,) variance of the mean over passes: constant + share x light^2, pooled over codes.

    Two passes alone give one degree of freedom for each code, so that single ones say little.
    """
    passes = len(grey)
    mean = grey.mean(axis=0)
    light2 = (mean - mean[0]) ** 2
    scatter = grey.var(axis=0, ddof=1)
    overall = max(float(scatter.mean()), 1e-12)
    # the most likely pair, as each scatter is chi-square of its variance: least squares would follow its
    # outliers
    design = np.stack([np.ones_like(light2), light2 / max(float(light2.max()), 1e-12)], axis=-1)
    terms = np.array([0.5, 0.5]) * overall
    for _ in range(_LIKELIHOOD_ROUNDS):
        model = design @ terms
        # multiplicative updates: terms stay above 0 (Fevotte and Idier 2011, doi:10.1162/NECO_a_00168)
        terms *= np.sqrt(((scatter / model**2) @ design) / ((1.0 / model) @ design))
        terms = np.maximum(terms, 1e-6 * overall)
    # two numbers were fitted to these scatters
    model = design @ terms * len(scatter) / (len(scatter) - 2)
    return np.asarray(model / passes)


def _curve(code: Ints, grey: Float) -> tuple[Curve, float]:
    """Curve of one region from (passes, n) grey, and its swing in grey levels."""
    variance = _variance(grey)
    mean = grey.mean(axis=0)
    rising = np.asarray(isotonic_regression(mean, weights=1.0 / variance).x)
    swing = float(rising[-1] - rising[0])
    if swing <= LEAST_SWING_SIGMAS * float(np.sqrt(variance[0] + variance[-1])):
        raise MeasurementError(
            f"response: white differs from black by {swing:.2g} grey levels, which is within the noise: is "
            "the LCD on, seen, and the exposure long enough?"
        )
    light = np.clip((rising - rising[0]) / swing, 0.0, 1.0)
    # What pooling makes of several codes is no worse than each by itself: a projection brings points nearer.
    spread = variance + (1 - light) ** 2 * variance[0] + light**2 * variance[-1]
    spread[[0, -1]] = 0.0
    gamma, gamma_sigma, misfit = _power_law(code / 255.0, mean, variance, light)
    return Curve(light, np.sqrt(spread) / swing, gamma, gamma_sigma, misfit), swing


def _power_law(share: Float, grey: Float, variance: Float, light: Float) -> tuple[float, float, float]:
    """Best gamma with black and white levels free, its standard deviation, the largest departure from it."""
    sigma = np.sqrt(variance)
    swing = grey[-1] - grey[0]

    def rest(terms: Float) -> Float:
        power = share ** np.exp(terms[2])
        return np.asarray((grey[0] + swing * (terms[0] + (1 + terms[1]) * power) - grey) / sigma)

    inner = (light > 0.05) & (light < 0.95)
    start = np.log(np.median(np.log(light[inner]) / np.log(share[inner]))) if inner.any() else np.log(2.2)
    found = least_squares(rest, np.array([0.0, 0.0, start]), x_scale=(0.01, 0.01, 0.01))
    covariance = np.linalg.pinv(found.jac.T @ found.jac)
    # where the curve is no power law, gamma is known no better than the misfit lets it
    excess = max(1.0, 2 * float(found.cost) / max(len(share) - 3, 1))
    gamma = float(np.exp(found.x[2]))
    misfit = float(np.max(np.abs(light - share**gamma)))
    return gamma, gamma * float(np.sqrt(covariance[2, 2] * excess)), misfit


def _smooth(codes: Ints, light: Float, at: Ints) -> Float:
    """Monotone cubic through the light of rising codes."""
    return np.asarray(PchipInterpolator(codes, light)(at))


def _rising(light: Float) -> Float:
    """The same, rounded, with every value above the last: ties are drawn apart by the least step."""
    steps = np.round(light / _LEAST_STEP).astype(np.int64)
    top = round(1 / _LEAST_STEP)
    order = np.arange(len(steps))
    upwards = np.maximum.accumulate(steps - order) + order
    room = top - (len(steps) - 1 - order)
    return np.asarray(np.minimum(upwards, room) / top)
