"""Masks of pixels without a place in the rest map; each reason has its own signature.

| reason | signature |
|---|---|
| no modulation | fringes below the noise, or far weaker than in the rest of the view |
| saturated | grey levels at the ceiling |
| dead | a few pixels without fringes, much dimmer than their neighbours, or looking elsewhere |
| disturbed | the mean light differs between sets, the shifts fit no harmonics, or repeats differ |
| second reflection | mean light and shifts are sound, but the periods' phases disagree, pixel after pixel |
| wrong order, ambiguous order | a jump against the neighbours; a rival order nearly as likely |

Each must both exceed the noise and be large enough to matter.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.special import chdtri, ndtri

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.decoding.decoding import Phasors, fit_matrices
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.unwrapping import Places

SIGMAS = 6.0
"""Deviation, in sigma, that less than one pixel in a hundred million has by noise alone."""

LEAST_SNR = 8.0
"""Least amplitude over its standard deviation: phases are then Gaussian, of 0.13 rad at most."""

LEAST_AMPLITUDE = 0.15
"""Share of the view's usual amplitude below which the light is stray or from a face, not the mirror."""

MEAN_SHARE = 0.02
"""Change of the mean light between sets that counts as a disturbance."""

MISFIT_SHARE = 0.03
"""Misfit of the shifts, rms over the mean light, that counts as a disturbance."""

MOVED_SHARE = 0.05
"""Change of a phasor between repeats, of its amplitude, that counts as a disturbance."""

_SAMPLES = 5000

SPREAD_PX = 3
"""Margin around a proven disturbance, for its half shadow."""

DEAD_AREA_PX = 9
"""Largest group of dead pixels; larger ones are something else."""

REFLECTED_SHARE = 0.1
"""Amplitude of a second reflection, over the fringes', whose disagreement marks a pixel as inconsistent."""

DIM_SHARE = 0.6
"""Amplitude over the median of 5 x 5 neighbours below which a pixel, of camera or LCD, is dead."""

POOL_PX = 9
"""Side of the square over which disagreement of the periods is pooled into a second reflection."""

SEED_SHARE = 0.25
"""Share of a connected second reflection that must exceed the limit for all of it to be masked."""

_LEAST_POOLED = 3.5
"""Pixels of a pool, fewer of which (whole numbers, but for rounding) show nothing."""

POOL_AGREES = 0.7
"""Share of a pool's pixels that must disagree more than noise does by median: half do by noise alone."""


def some_of(values: Image, where: Mask, most: int = _SAMPLES) -> Image:
    """Values (..., n) of some of the pixels `where`, spread evenly, of values (..., rows, cols)."""
    index = np.flatnonzero(where)
    return values.reshape(*values.shape[:-2], -1)[..., index[:: len(index) // most + 1]]


def gains(phasors: Phasors, lit: Mask) -> tuple[Float, float]:
    """Light of each set (sets,) over the usual one in the pixels `lit`, and what else changes it, relative.

    The gains are those of a drifting backlight. The rest is the noise of a set's mean light and the harmonics
    that the shifts alias onto it, as a standard deviation.
    """
    if not lit.any():
        return np.ones(len(phasors.mean)), 0.0
    some = some_of(phasors.mean, lit, 500)
    share = some / np.maximum(np.median(some, axis=0), np.float32(1e-9))
    gain = np.median(share, axis=1).astype(np.float64)
    gain = np.where(gain > 0, gain, 1.0)
    off = np.abs(share / gain[:, None] - 1.0)
    return gain, float(np.quantile(off, 0.75)) / float(ndtri(0.875))


def median_light(phasors: Phasors, gain: Float, noise: NoiseModel, usual: float) -> tuple[Single, Single]:
    """Mean light (rows, cols) as the median of all sets without their gains, and its largest change.

    The change is 0 where it is no more than noise, or than what changes everywhere: `usual`, see `gains`.
    """
    within = SIGMAS**2 * mean_noise(phasors)
    limit = within * noise.constant_grey2, within * noise.slope_grey
    share = max(MEAN_SHARE, SIGMAS * usual)
    flat = phasors.mean.reshape(len(gain), -1)
    least, most, total = (np.full(flat.shape[1], start) for start in (np.inf, -np.inf, 0.0))
    for of_set, by in zip(flat, 1.0 / gain, strict=True):
        value = of_set * by
        np.minimum(least, value, out=least)
        np.maximum(most, value, out=most)
        total += value
    middle, spread = total / len(gain), most - least
    at = np.flatnonzero((spread > share * middle) & (spread**2 > limit[0] + limit[1] * middle))
    typical, change = middle.astype(np.float32), np.zeros(flat.shape[1], np.float32)
    if len(at):
        median = np.median(flat[:, at] / gain[:, None], axis=0)
        off = np.maximum(most[at] - median, median - least[at])
        typical[at], change[at] = median, np.where(off > share * median, off, 0.0)
    shape = phasors.mean.shape[1:]
    return typical.reshape(shape), change.reshape(shape)


def mean_noise(phasors: Phasors) -> float:
    """Variance of a set's mean light over that of one reading."""
    return float(np.sum(fit_matrices(phasors.sequence.shifts_rad)[1][0] ** 2))


def amplitude(phasors: Phasors) -> tuple[Single, Single]:
    """Amplitude of the fringes, rms over axes and periods, grey; the least, squared (rows, cols)."""
    total = np.zeros_like(phasors.mean[0])
    least = np.full_like(total, np.inf)
    for cosine, sine in zip(phasors.cosine, phasors.sine, strict=True):
        for c, s in zip(cosine, sine, strict=True):
            power = c * c + s * s
            total += power
            np.minimum(least, power, out=least)
    return np.sqrt(total / sum(map(len, phasors.cosine))), least


def fringed(rms_amplitude: Single) -> Mask:
    """Pixels whose fringes are not far weaker than usual in the view, however little of it shows fringes.

    Usual is the amplitude up to which pixels hold half of all fringes' power.
    """
    flat = rms_amplitude.ravel()
    some = np.sort(flat[:: len(flat) // _SAMPLES | 1])  # odd: not the same few columns
    power = np.cumsum(some.astype(np.float64) ** 2)
    usual = some[np.searchsorted(power, 0.5 * power[-1])]
    return np.asarray(rms_amplitude > LEAST_AMPLITUDE * usual)


def unmodulated(phasors: Phasors, noise: NoiseModel, mean: Single, weakest: Single, lit: Mask) -> Mask:
    """Pixels without the fringes of every period, or with fringes as weak as from a face or stray light.

    weakest: squared amplitude of the weakest, see `amplitude`.
    """
    _, solve = fit_matrices(phasors.sequence.shifts_rad)
    gain = max(float(np.sum(solve[1] ** 2)), float(np.sum(solve[2] ** 2))) / phasors.sequence.repeats
    return np.asarray(~lit | (weakest < LEAST_SNR**2 * gain * noise.variance(mean)))


def disturbed(
    phasors: Phasors, noise: NoiseModel, mean: Single, change: Single, rms_amplitude: Single, lit: Mask
) -> Mask:
    """Pixels of `lit` whose light changed between or within the sets, without margin."""
    _, solve = fit_matrices(phasors.sequence.shifts_rad)
    variance = noise.variance(mean)
    if not lit.any():
        return np.zeros_like(lit)
    found = lit & (change**2 > SIGMAS**2 * mean_noise(phasors) * variance)
    if phasors.set_degrees > 0:
        misfit = np.sqrt(phasors.worst_scatter)
        limit = np.sqrt(chdtri(phasors.set_degrees, 1e-9) / phasors.set_degrees)
        relative = misfit / np.maximum(mean, 1e-9)
        # harmonics that too few shifts cannot fit are everywhere, a disturbance is local
        usual = 4.0 * float(np.median(some_of(relative, lit)))
        found |= lit & (misfit > limit * np.sqrt(variance)) & (relative > max(MISFIT_SHARE, usual))
    if phasors.sequence.repeats > 1:
        moved_noise = np.sqrt(2.0 * variance * np.sum(solve[1:3] ** 2))
        moved = (phasors.moved > SIGMAS * moved_noise) & (phasors.moved > MOVED_SHARE * rms_amplitude)
        found |= lit & moved
    return np.asarray(found)


def with_margin(mask: Mask, reach_px: int = SPREAD_PX) -> Mask:
    """The mask and all pixels within `reach_px` of it."""
    if not mask.any():
        return mask.copy()
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1,) * 2)
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(np.bool_)


def small_parts(mask: Mask) -> Mask:
    """Connected parts of the mask of at most `DEAD_AREA_PX` pixels."""
    if not mask.any():
        return mask.copy()
    label = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)[1]
    of_mask = label[mask]
    out = np.zeros_like(mask)
    out[mask] = (np.bincount(of_mask) <= DEAD_AREA_PX)[of_mask]
    return out


def dimmed(rms_amplitude: Single, weak: Mask) -> Mask:
    """Small parts far dimmer than the fringes around them; weak: pixels without fringes."""
    surrounded = cv2.medianBlur(weak.astype(np.uint8), 5) == 0
    around = cv2.medianBlur(np.ascontiguousarray(rms_amplitude, dtype=np.float32), 5)
    return small_parts((rms_amplitude < DIM_SHARE * around) & surrounded)


def second_reflection(places: Places, usable: Mask, limit_share: float) -> tuple[Single, Mask]:
    """Light of a second reflection relative to the main one (rows, cols), and where it exceeds `limit_share`.

    A second place at distance D turns the phase of period P by share x sin(2 pi D / P) at most: the periods
    then disagree, by share^2 / 2 per phase on average over D. The share follows from the excess of chi^2,
    pooled over `POOL_PX` squared; 0 where it is within two standard deviations of noise. A second place
    nearer than about a third of the shortest period shifts all periods equally, like blur, and is not found.
    """
    degrees, usual = places.degrees, float(chdtri(places.degrees, 0.5))
    chi2 = np.where(usable, places.chi2, np.float32(0.0))
    stiffness = np.where(usable, places.stiffness, np.float32(0.0))
    count, stiff, found, agree = (
        np.asarray(cv2.boxFilter(part.astype(np.float32), -1, (POOL_PX,) * 2, normalize=False))
        for part in (usable, stiffness, chi2, chi2 > usual)
    )
    # coherent errors go as a squared sine over the view: half its mean square scatters
    coherent = 0.5 * (places.coherent * degrees) ** 2
    excess = found - degrees * count
    doubt2 = (2.0 * degrees + coherent * count) * count
    real = (excess > 0.0) & (excess**2 > 4.0 * doubt2)
    share = np.zeros(usable.shape, np.float32)
    shown = real & (count > _LEAST_POOLED)
    share[shown] = np.sqrt(2.0 * excess[shown] / np.maximum(stiff[shown], 1e-6 * count[shown]))
    proven = real & usable & (agree > POOL_AGREES * count) & (excess**2 > SIGMAS**2 * doubt2)
    return share, _extended(proven & (share > limit_share), proven) & usable


def _extended(found: Mask, proven: Mask) -> Mask:
    """Second reflections above the limit, with the connected parts that appear weaker than they are.

    The distance of two reflections varies over the view; where it is near 0 or near whole periods, the
    periods agree although the light is that of the neighbourhood. A part of which less than `SEED_SHARE` is
    above the limit is above it by noise.
    """
    if not found.any():
        return found
    label = cv2.connectedComponents(proven.view(np.uint8), connectivity=8)[1][proven]
    seeds = np.bincount(label, weights=found[proven])
    reached = found.astype(np.uint8)
    reached[proven] |= (seeds > SEED_SHARE * np.bincount(label))[label]
    # a square, of the area of a disc of that radius, is closed in a tenth of the time
    square = np.ones((2 * POOL_PX - 1,) * 2, np.uint8)
    return cv2.morphologyEx(reached, cv2.MORPH_CLOSE, square).astype(np.bool_)


def inconsistent(places: Places) -> Mask:
    """Single pixels whose periods disagree beyond noise, as a reflection of `REFLECTED_SHARE` makes them."""
    far = places.chi2 > chdtri(places.degrees, 1e-8)
    return np.asarray(far & (2.0 * (places.chi2 - places.degrees) > REFLECTED_SHARE**2 * places.stiffness))
