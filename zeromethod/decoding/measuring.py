"""Measurement of the rest map: decode and unwrap a fringe sequence, with reasons for invalid pixels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from zeromethod.arrays import Flags, Float, Image, Mask, Single
from zeromethod.decoding.consistency import compare_neighbours, jumped_patches
from zeromethod.decoding.decoding import Phasors, decode_phasors
from zeromethod.decoding.flicker import find_flicker
from zeromethod.decoding.fringes import FringeSequence
from zeromethod.decoding.harmonics import agreement, sample
from zeromethod.decoding.masks import (
    POOL_PX,
    SIGMAS,
    amplitude,
    dimmed,
    disturbed,
    fringed,
    gains,
    inconsistent,
    median_light,
    second_reflection,
    small_parts,
    some_of,
    unmodulated,
    with_margin,
)
from zeromethod.decoding.near_reflection import near_reflection
from zeromethod.decoding.noise import QUANTISATION, NoiseModel, fit_noise
from zeromethod.decoding.periods import order_error, unambiguous_range
from zeromethod.decoding.unwrapping import Places, Waves, unwrap
from zeromethod.errors import InputError
from zeromethod.warp.rest_map import Reason, RestMap

LIMIT_SHARE = 0.03
"""Default of the largest second reflection that is accepted (and then counted in sigma)."""

AMBIGUOUS_ODDS = 0.01
"""Odds of the second-best order above which neighbours must confirm a pixel's order."""

OUTLIER_PX = 0.25
"""Deviation from its neighbours, LCD px, below which no pixel is dead: the LCD's grid causes as much."""

_SAMPLES = 3000

SMALLEST_PANEL_PX = 640
"""Least unambiguous range of the periods where the panel's size is not given."""

_TYPICAL_PHASE_SIGMA = 0.03
"""Phase noise, rad, assumed for the unambiguous range where the panel's size is not given."""


@dataclass(frozen=True, slots=True)
class RestMeasurement:
    """A rest map with the figures of its measurement; arrays are (rows, cols) in camera pixels.

    amplitude, mean: of the fringes, grey levels. odds: of the second-best order, the worse of both axes.
    reflection: light of a second reflection relative to the main one, where it exceeds noise. noise: the
    model behind sigma; noise_found: whether it came from the frames' scatter. scatter_ratio: the frames'
    scatter over the given model's prediction, as a standard deviation (NaN where none was given); sigma
    includes it where above 1. second_harmonic: share of the fundamental, NaN where the shifts are too few.
    folded_harmonic: largest share of a harmonic that the shifts aliased onto the fundamental, and that was
    removed. light_drift: largest change of the whole view's light between sets. flicker: its change from
    frame to frame, rms, 0 where too small to be seen; see `decoding.flicker`. phase_sigma_rad: median of the
    valid. order_error: share of wrong orders predicted from it and the periods. size_px: LCD (columns, rows)
    searched. near_px: distance, LCD px, of a second reflection of a tenth of the light that is too near to be
    masked, 0 for none; it moves places by a tenth of that. See `near_reflection`.
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
    flicker: float
    phase_sigma_rad: float
    order_error: float
    size_px: tuple[float, float]
    near_px: float = 0.0

    def count(self, reason: Reason) -> int:
        """Number of camera pixels with a reason.

        Parameters
        ----------
        reason : Reason
            Why a pixel has no position.

        Returns
        -------
        int
            Pixels.
        """
        return int(np.count_nonzero(self.rest_map.reason & int(reason)))


@dataclass(frozen=True, slots=True)
class _Light:
    """Light of the view without fringes, its noise, and the fringes' amplitude; see `RestMeasurement`.

    weakest: (rows, cols) squared amplitude of the weakest fringes, grey^2. lit: (rows, cols) where fringes
    are about as strong as usual in the view.
    """

    mean: Single
    change: Single
    gain: Float
    amplitude: Single
    weakest: Single
    lit: Mask
    noise: NoiseModel
    ratio: float

    @classmethod
    def of(cls, phasors: Phasors, given: NoiseModel | None) -> _Light:
        rms_amplitude, weakest = amplitude(phasors)
        lit = fringed(rms_amplitude)
        lit &= ~small_parts(lit)
        gain, usual = gains(phasors, lit)
        noise, ratio = _noise(phasors, given, lit)
        mean, change = median_light(phasors, gain, noise, usual)
        return cls(mean, change, gain, rms_amplitude, weakest, lit, noise, ratio)


def _noise(phasors: Phasors, given: NoiseModel | None, lit: Mask) -> tuple[NoiseModel, float]:
    """Noise model to use, and the scatter's standard deviation over the given model's."""
    rows = phasors.sampled
    at = np.flatnonzero(lit[rows] & ~phasors.saturated[rows])
    at = at[:: len(at) // _SAMPLES + 1]
    means = phasors.mean[:, rows].reshape(len(phasors.mean), -1)
    grey, scatter = means[:, at].mean(axis=0), phasors.scatter.ravel()[at]
    if given is None:
        found = fit_noise(grey, scatter, phasors.degrees)
        if found is None:  # hardly any light: any noise model gives that result
            known = float(np.median(phasors.scatter)) if phasors.scatter.size else 0.0
            found = NoiseModel(max(known, QUANTISATION), 0.0)
        return found, float("nan")
    if phasors.degrees == 0 or len(at) == 0:
        return given, float("nan")
    relative = scatter / given.variance(grey)
    ratio = float(np.median(relative)) / float(chdtri(phasors.degrees, 0.5) / phasors.degrees)
    if ratio <= 1.0:
        return given, float(np.sqrt(ratio))
    return given.scaled(ratio), float(np.sqrt(ratio))


def measure_rest(
    frames: Iterable[Image],
    sequence: FringeSequence,
    *,
    size_px: tuple[int, int] | None = None,
    noise: NoiseModel | None = None,
    ceiling_grey: float | None = None,
    limit_share: float = LIMIT_SHARE,
) -> RestMeasurement:
    """Measure the absolute LCD position of every camera pixel.

    Parameters
    ----------
    frames : iterable of (rows, cols) arrays
        Grey images in the sequence's order, read one set of shifts at a time.
    sequence : FringeSequence
        What was shown.
    size_px : (int, int), optional
        LCD (columns, rows); without it orders are searched over the unambiguous range of the periods.
    noise : NoiseModel, optional
        Of the camera; by default from the frames' scatter.
    ceiling_grey : float, optional
        Level from which a pixel is saturated; by default the largest of an integer type.
    limit_share : float
        Largest second reflection accepted, of the main one's light.

    Returns
    -------
    RestMeasurement

    Raises
    ------
    InputError
        For frames that do not fit the sequence and, without size_px, for periods of too short a range.
    """
    if size_px is None:
        columns, rows = (unambiguous_range(one, _TYPICAL_PHASE_SIGMA) for one in sequence.periods)
        searched = (columns, rows)
        if min(searched) < SMALLEST_PANEL_PX:
            raise InputError(
                f"panel: size not given: these periods are unambiguous over {min(searched):.0f} px only; "
                "give columns and rows of the LCD"
            )
    else:
        searched = (float(size_px[0]), float(size_px[1]))
    phasors = decode_phasors(frames, sequence, ceiling_grey)
    light = _Light.of(phasors, noise)
    reason, weak = _light_reasons(phasors, light)
    found = _places(phasors, light, noise, searched, ~weak, reason == 0)
    flicker = find_flicker(
        phasors, found[0], (reason == 0) & np.isfinite(found[0][0].x_px + found[0][1].x_px)
    )
    if flicker.share:
        phasors = flicker.phasors
        found = _places(phasors, light, noise, searched, ~weak, reason == 0)
    places, light, folded = [flicker.counted(place) for place in found[0]], *found[1:]
    lcd = np.stack([place.x_px for place in places], axis=-1)
    sound = (reason == 0) & np.isfinite(places[0].x_px) & np.isfinite(places[1].x_px)
    sigma, reflection = _agreement(places, sound, limit_share, reason)
    odds = np.maximum(places[0].odds, places[1].odds)
    for axis, size in enumerate(searched):
        past_px = np.abs(places[axis].x_px - 0.5 * (size - 1.0)) - 0.5 * size
        _add(reason, Reason.OFF_DISPLAY, sound & (past_px > 3.0 * places[axis].sigma_px))
    half_px = np.array([0.5 * min(periods) for periods in sequence.periods])
    _compare_neighbours(lcd, sigma, sound, odds > AMBIGUOUS_ODDS, half_px, reason)

    valid = sound & (reason == 0)
    lcd[~valid] = sigma[~valid] = np.nan
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
        flicker=flicker.share,
        light_drift=float(np.max(np.abs(light.gain / np.median(light.gain) - 1.0))),
        phase_sigma_rad=phase_sigma,
        order_error=max(map(order_error, sequence.periods, (phase_sigma,) * 2, searched)),
        size_px=searched,
        near_px=near_reflection(phasors, places, valid),
    )


def _add(reason: Flags, why: Reason, mask: Mask) -> None:
    reason[mask] |= np.uint16(int(why))


def _light_reasons(phasors: Phasors, light: _Light) -> tuple[Flags, Mask]:
    """Reasons by mean light, amplitude and fit of the shifts, and where fringes are too weak to decode."""
    reason = np.zeros(light.mean.shape, dtype=np.uint16)
    changed = disturbed(phasors, light.noise, light.mean, light.change, light.amplitude, light.lit)
    single = small_parts(changed)
    _add(reason, Reason.DISTURBED, with_margin(changed & ~single))
    weak = unmodulated(phasors, light.noise, light.mean, light.weakest, light.lit)
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
    searched: tuple[float, float],
    bright: Mask,
    sound: Mask,
) -> tuple[list[Places], _Light, float]:
    """Places along both axes without an aliased harmonic; the light with its noise; the harmonic's share."""
    usual = light.noise.variance(float(np.median(some_of(light.mean, sound))) if sound.any() else 0.0)
    least = float((QUANTISATION if given is None else given.constant_grey2) / usual)
    at = sample(sound)
    agreed = [
        agreement(phasors, axis, light.noise, light.mean, searched[axis], at, min(least, 1.0))
        for axis in range(2)
    ]
    places = []
    for axis, one in enumerate(agreed):
        waves = Waves.of(phasors, axis, light.noise, light.mean)
        factor = one.noise * one.excess[:, None]
        if (factor != 1.0).any():
            waves = waves.scaled(factor)
        coherent = float(np.sum(1.0 - 1.0 / one.excess)) / (len(one.excess) - 1)
        places.append(unwrap(waves, searched[axis], bright, one.tables, coherent))
    scale = float(np.median(np.concatenate([one.noise for one in agreed])))
    light = replace(light, noise=light.noise.scaled(scale))
    return places, light, max(float(np.max(np.abs(one.shares))) for one in agreed)


def _agreement(places: list[Places], sound: Mask, limit_share: float, reason: Flags) -> tuple[Float, Single]:
    """Sigma (rows, cols, 2) including second reflections, and their share; adds reasons."""
    odd = np.logical_or(*(inconsistent(place) for place in places)) & sound
    pooled = sound & ~small_parts(odd)
    reflection = np.zeros(sound.shape, dtype=np.float32)
    sigma = np.empty((*sound.shape, 2))
    for axis, place in enumerate(places):
        share, doubled = second_reflection(place, pooled, limit_share)
        _add(reason, Reason.SECOND_REFLECTION, doubled)
        reflection = np.maximum(reflection, share)
        sigma[..., axis] = np.sqrt(place.sigma_px**2 + 0.5 * share**2 * place.leverage_px2)
    # at its rim the pool has too few pixels of a second reflection to prove it
    near = with_margin((reason & int(Reason.SECOND_REFLECTION)) != 0, POOL_PX // 2 + 1)
    _add(reason, Reason.SECOND_REFLECTION, odd & near)
    _add(reason, Reason.INCONSISTENT, odd & (reason == 0))
    return sigma, reflection


def _median(places: list[Places], valid: Mask) -> float:
    if not valid.any():
        return float("nan")
    return float(np.median([some_of(place.phase_sigma_rad, valid, 1000) for place in places]))


def _compare_neighbours(
    lcd: Float, sigma: Float, sound: Mask, ambiguous: Mask, half_px: Float, reason: Flags
) -> None:
    """Add wrong and ambiguous orders and dead pixels to `reason`: patches first, then single pixels."""
    usable = sound & (reason & int(Reason.OFF_DISPLAY | Reason.SECOND_REFLECTION) == 0)
    jumped = jumped_patches(lcd, usable, half_px)
    usable &= ~jumped
    bounds = SIGMAS, OUTLIER_PX
    outlying, far, confirmed = compare_neighbours(lcd, usable, sigma, bounds, half_px)
    _add(reason, Reason.WRONG_ORDER, jumped | far)
    _add(reason, Reason.AMBIGUOUS_ORDER, sound & ambiguous & ~confirmed)
    _add(reason, Reason.DEAD, small_parts(outlying & ~far))
