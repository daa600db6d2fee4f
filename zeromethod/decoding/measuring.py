"""From the frames of a fringe sequence to the rest map: decode, unwrap, and name what may not be trusted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from zeromethod.arrays import Flags, Float, Image, Mask, Single
from zeromethod.decoding.consistency import departures, jumped_patches
from zeromethod.decoding.decoding import Phasors, decode_phasors
from zeromethod.decoding.fringes import FringeSequence
from zeromethod.decoding.harmonics import LEAST_SHARE, folded_harmonic, without_harmonic
from zeromethod.decoding.masks import (
    LEAST_AMPLITUDE,
    POOL_PX,
    SIGMAS,
    amplitude,
    dimmed,
    disturbed,
    inconsistent,
    second_reflection,
    small_parts,
    spread,
    steady_mean,
    unmodulated,
)
from zeromethod.decoding.near_reflection import near_reflection
from zeromethod.decoding.noise import QUANTISATION, NoiseModel, fit_noise
from zeromethod.decoding.periods import order_error, unambiguous_range
from zeromethod.decoding.unwrapping import Places, unwrap
from zeromethod.errors import InputError
from zeromethod.warp.rest_map import Reason, RestMap

LIMIT_SHARE = 0.03
"""Default of the largest second reflection that is accepted (and then counted in sigma)."""

DOUBTFUL_ODDS = 0.01
"""Odds of the second-best order from which on its neighbours must confirm a pixel's own."""

OUTLIER_PX = 0.25
"""Departure from its neighbours, LCD px, below which no pixel is called dead: the LCD's grid does as much."""

_HARMONIC_ROUNDS = 4

_CURVED_SHARE = 0.05
"""Second harmonic from which on the LCD's response counts as curved."""

SMALLEST_PANEL_PX = 640
"""Periods must reach this far where the panel's size is not given: any LCD could be meant."""

_TYPICAL_PHASE_SIGMA = 0.03
"""Phase noise, rad, for which the panel's size is guessed where it is not given."""


@dataclass(frozen=True, slots=True)
class RestMeasurement:
    """A rest map and what was learnt on the way, all (rows, cols) in camera pixels.

    amplitude, mean: of the fringes, grey levels. odds: of the second-best order, the worse of both axes.
    reflection: light of a second reflection relative to the main one, as far as it is beyond noise. noise:
    the model behind sigma; noise_found: whether the frames' scatter gave it. scatter_ratio: the frames'
    scatter over what the given model foretold, as a standard deviation (NaN where none was given); sigma
    counts it where above 1. second_harmonic: share of the fundamental, NaN where too few shifts tell.
    folded_harmonic: largest share of a harmonic that the shifts folded onto the fundamental, and that was
    taken out. light_drift: largest change of the whole view's light between sets. phase_sigma_rad: median of
    the valid. expected_wrong: share of valid pixels that the odds say are wrong before neighbours were asked.
    order_error: the same foretold from phase_sigma_rad and the periods. size_px: LCD (columns, rows) sought.
    near_px: distance, LCD px, of a second reflection of a tenth of the light that is too near to be left out,
    0 where none is seen; it moves places by a tenth of that. See `near_reflection`.
    """

    rest_map: RestMap
    amplitude: Single
    mean: Single
    odds: Single
    reflection: Single
    noise: NoiseModel
    noise_found: bool
    scatter_ratio: float
    second_harmonic: float
    folded_harmonic: float
    light_drift: float
    phase_sigma_rad: float
    expected_wrong: float
    order_error: float
    size_px: tuple[float, float]
    near_px: float = 0.0

    def count(self, reason: Reason) -> int:
        """Camera pixels against which a reason holds."""
        return int(np.count_nonzero(self.rest_map.reason & int(reason)))


@dataclass(frozen=True, slots=True)
class _Light:
    """Light of the view without fringes, its noise, and the fringes' amplitude; see `RestMeasurement`."""

    mean: Single
    change: Single
    gain: Float
    amplitude: Single
    noise: NoiseModel
    ratio: float

    @classmethod
    def of(cls, phasors: Phasors, given: NoiseModel | None) -> _Light:
        mean, change, gain = steady_mean(phasors)
        rms_amplitude = amplitude(phasors)
        noise, ratio = _noise(phasors, given, mean, rms_amplitude)
        return cls(mean, change, gain, rms_amplitude, noise, ratio)


def _noise(
    phasors: Phasors, given: NoiseModel | None, mean: Single, rms_amplitude: Single
) -> tuple[NoiseModel, float]:
    """Noise model to count with, and the scatter's standard deviation over the given model's."""
    bright = rms_amplitude >= LEAST_AMPLITUDE * np.quantile(rms_amplitude, 0.9)
    bright &= ~phasors.saturated
    if given is None:
        found = fit_noise(mean[bright], phasors.scatter[bright], phasors.degrees)
        if found is None:  # next to nothing is seen: any noise will do to say so
            found = NoiseModel(max(float(np.median(phasors.scatter)), QUANTISATION), 0.0)
        return found, float("nan")
    if phasors.degrees == 0 or not bright.any():
        return given, float("nan")
    relative = phasors.scatter[bright] / given.variance(mean[bright])
    ratio = float(np.median(relative)) / float(chdtri(phasors.degrees, 0.5) / phasors.degrees)
    if ratio <= 1.0:
        return given, float(np.sqrt(ratio))
    return NoiseModel(given.constant_grey2 * ratio, given.slope_grey * ratio), float(np.sqrt(ratio))


def _agreed(
    model: NoiseModel, given: NoiseModel | None, places: list[Places], sound: Mask, degrees: int
) -> NoiseModel:
    """The model brought down to what the agreement of the periods allows, but not below the given one."""
    squares = np.concatenate([place.chi2[sound] for place in places])
    squares = squares[np.isfinite(squares)]
    if len(squares) == 0:
        return model
    ratio = min(float(np.median(squares)) / float(chdtri(degrees, 0.5)), 1.0)
    if given is not None:
        ratio = max(ratio, given.constant_grey2 / model.constant_grey2 if model.constant_grey2 > 0 else 1.0)
    return NoiseModel(model.constant_grey2 * ratio, model.slope_grey * ratio)


def measure_rest(
    frames: Iterable[Image],
    sequence: FringeSequence,
    *,
    size_px: tuple[int, int] | None = None,
    noise: NoiseModel | None = None,
    ceiling_grey: float | None = None,
    limit_share: float = LIMIT_SHARE,
) -> RestMeasurement:
    """Absolute LCD position of every camera pixel.

    frames: grey images (rows, cols) in the sequence's order, read one set of shifts at a time. size_px: LCD
    (columns, rows); without it orders are sought as far as the periods tell them apart. noise: of the camera;
    from the frames' scatter when left out. ceiling_grey: saturated from here on; the largest of an integer
    type when left out. limit_share: largest second reflection accepted, of the main one's light.
    Raises InputError for frames that do not fit the sequence, and without
    size_px for periods that reach less far than panels do.
    """
    if size_px is None:
        reach = unambiguous_range(sequence.periods_px, _TYPICAL_PHASE_SIGMA)
        if reach < SMALLEST_PANEL_PX:
            raise InputError(
                f"panel: size not given: these periods tell places apart over {reach:.0f} px only: "
                "columns and rows of the LCD"
            )
        sought = (reach, reach)
    else:
        sought = (float(size_px[0]), float(size_px[1]))
    phasors = decode_phasors(frames, sequence, ceiling_grey)
    light = _Light.of(phasors, noise)
    reason, weak = _light_reasons(phasors, light)
    places, light, folded = _places(phasors, light, noise, sought, ~weak, reason == 0)
    lcd = np.stack([place.x_px for place in places], axis=-1)
    sound = (reason == 0) & np.isfinite(lcd).all(axis=-1)
    sigma, reflection = _agreement(places, sound, len(sequence.periods_px) - 1, limit_share, reason)
    odds = np.maximum(places[0].odds, places[1].odds)
    for axis, size in enumerate(sought):
        past_px = np.abs(lcd[..., axis] - 0.5 * (size - 1.0)) - 0.5 * size
        _add(reason, Reason.OFF_DISPLAY, sound & (past_px > 3.0 * places[axis].sigma_px))
    _ask_neighbours(lcd, sigma, sound, odds > DOUBTFUL_ODDS, 0.5 * min(sequence.periods_px), reason)

    valid = sound & (reason == 0)
    lcd[~valid] = np.nan
    sigma[~valid] = np.nan
    phase_sigma = _median(places, valid)
    return RestMeasurement(
        rest_map=RestMap(lcd, sigma, valid, reason),
        amplitude=light.amplitude,
        mean=light.mean,
        odds=odds,
        reflection=reflection,
        noise=light.noise,
        noise_found=noise is None,
        scatter_ratio=light.ratio,
        second_harmonic=phasors.second_harmonic,
        folded_harmonic=folded,
        light_drift=float(np.max(np.abs(light.gain / np.median(light.gain) - 1.0))),
        phase_sigma_rad=phase_sigma,
        expected_wrong=_expected_wrong(places, valid),
        order_error=max(order_error(sequence.periods_px, phase_sigma, size) for size in sought),
        size_px=sought,
        near_px=near_reflection(phasors, places, valid),
    )


def _add(reason: Flags, why: Reason, mask: Mask) -> None:
    reason[mask] |= np.uint16(int(why))


def _light_reasons(phasors: Phasors, light: _Light) -> tuple[Flags, Mask]:
    """Reasons from mean light, amplitude and the shifts' fit, and where fringes are too weak to decode."""
    reason = np.zeros(light.mean.shape, dtype=np.uint16)
    changed = disturbed(phasors, light.noise, light.mean, light.change, light.amplitude)
    single = small_parts(changed)
    _add(reason, Reason.DISTURBED, spread(changed & ~single))
    weak = unmodulated(phasors, light.noise, light.mean, light.amplitude)
    dim = dimmed(light.amplitude, weak)
    holes = small_parts(weak | phasors.saturated) & (dim | phasors.saturated)
    _add(reason, Reason.DEAD, single | holes | dim)
    _add(reason, Reason.NO_MODULATION, weak & ~holes & (reason & int(Reason.DISTURBED) == 0))
    _add(reason, Reason.SATURATED, phasors.saturated)
    return reason, weak


def _places(
    phasors: Phasors,
    light: _Light,
    given: NoiseModel | None,
    sought: tuple[float, float],
    seen: Mask,
    sound: Mask,
) -> tuple[list[Places], _Light, float]:
    """Places along both axes, rid of a folded harmonic; the light with its noise; the harmonic's share."""

    def unwrapped(source: Phasors) -> list[Places]:
        return [unwrap(source, axis, light.noise, light.mean, sought[axis], seen) for axis in range(2)]

    periods = len(phasors.sequence.periods_px)
    corrected, folded = phasors, np.zeros((2, periods))
    places = unwrapped(corrected)
    for _ in range(_HARMONIC_ROUNDS):
        step = folded_harmonic(corrected, places, sound)
        if np.max(np.abs(step)) < LEAST_SHARE:
            break
        folded += step
        corrected = without_harmonic(phasors, folded)
        places = unwrapped(corrected)
    if periods > 1 and (phasors.from_neighbours or phasors.second_harmonic > _CURVED_SHARE):
        # What passes for scatter may hold harmonics or fringes; the periods' agreement does not.
        light = replace(light, noise=_agreed(light.noise, given, places, sound, periods - 1))
        places = unwrapped(corrected)
    return places, light, float(np.max(np.abs(folded)))


def _agreement(
    places: list[Places], sound: Mask, degrees: int, limit_share: float, reason: Flags
) -> tuple[Float, Single]:
    """Sigma (rows, cols, 2) with what second reflections add, their share; adds reasons."""
    odd = np.logical_or(*(inconsistent(place, degrees) for place in places)) & sound
    pooled = sound & ~small_parts(odd)
    reflection = np.zeros(sound.shape, dtype=np.float32)
    sigma = np.empty((*sound.shape, 2))
    for axis, place in enumerate(places):
        share, doubled = second_reflection(place, pooled, degrees, limit_share)
        _add(reason, Reason.SECOND_REFLECTION, doubled)
        reflection = np.maximum(reflection, share)
        sigma[..., axis] = np.sqrt(place.sigma_px**2 + 0.5 * share**2 * place.leverage_px2)
    # At its rim the pool holds too few pixels of a second reflection to prove it.
    near = spread((reason & int(Reason.SECOND_REFLECTION)) != 0, POOL_PX // 2 + 1)
    _add(reason, Reason.SECOND_REFLECTION, odd & near)
    _add(reason, Reason.INCONSISTENT, odd & (reason == 0))
    return sigma, reflection


def _expected_wrong(places: list[Places], valid: Mask) -> float:
    odds = [place.odds[valid] for place in places]
    return float(sum(np.mean(o / (1.0 + o)) for o in odds)) if valid.any() else 0.0


def _median(places: list[Places], valid: Mask) -> float:
    if not valid.any():
        return float("nan")
    return float(np.median(np.stack([place.phase_sigma_rad[valid] for place in places])))


def _ask_neighbours(
    lcd: Float, sigma: Float, sound: Mask, doubtful: Mask, half_px: float, reason: Flags
) -> None:
    """Add wrong and doubtful orders and dead pixels to `reason`: patches first, then single pixels."""
    usable = sound & (reason & int(Reason.OFF_DISPLAY | Reason.SECOND_REFLECTION) == 0)
    jumped = jumped_patches(lcd, usable, half_px)
    usable &= ~jumped
    departed = np.abs(departures(lcd, usable))
    confirmed = (departed < half_px).all(axis=-1)
    far = (departed > half_px).any(axis=-1)
    _add(reason, Reason.WRONG_ORDER, jumped | far)
    _add(reason, Reason.DOUBTFUL_ORDER, sound & doubtful & ~confirmed)
    outlying = (departed > np.maximum(SIGMAS * sigma, OUTLIER_PX)).any(axis=-1) & ~far & usable
    _add(reason, Reason.DEAD, small_parts(outlying))
