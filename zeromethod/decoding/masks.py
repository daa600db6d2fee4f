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
import numba
import numpy as np
from scipy.special import chdtri

from zeromethod.arrays import Float, Mask, Single
from zeromethod.decoding.consistency import insert_sorted
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

SPREAD_PX = 3
"""Margin around a proven disturbance, for its half shadow."""

DEAD_AREA_PX = 9
"""Largest group of dead pixels; larger ones are something else."""

DIM_SHARE = 0.6
"""Amplitude over the median of 5 x 5 neighbours below which a pixel, of camera or LCD, is dead."""

POOL_PX = 9
"""Side of the square over which disagreement of the periods is pooled into a second reflection."""

SEED_SHARE = 0.25
"""Share of a connected second reflection that must exceed the limit for all of it to be masked."""

POOL_AGREES = 0.7
"""Share of a pool's pixels that must disagree more than noise does by median: half do by noise alone."""


@numba.njit(cache=True)
def _median_of_sets(mean: Single, gain: Float, typical: Single, change: Single) -> None:
    """Median over the sets, and the largest departure from it."""
    count, rows, cols = mean.shape
    value = np.empty(count)
    for j in range(rows):
        for i in range(cols):
            for n in range(count):
                insert_sorted(value, n, mean[n, j, i] / gain[n])
            middle = 0.5 * (value[(count - 1) // 2] + value[count // 2])
            typical[j, i] = middle
            change[j, i] = max(value[count - 1] - middle, middle - value[0])


def median_light(phasors: Phasors) -> tuple[Single, Single, Float]:
    """Mean light (rows, cols) as the median of all sets, its largest change, and each set's gain (sets,).

    The gain removes changes of the whole view: a drifting backlight.
    """
    sets = phasors.mean.reshape(len(phasors.mean), -1)
    some = sets[:, :: max(1, sets.shape[1] // 20_000)].astype(np.float64)
    centre = np.maximum(np.median(some, axis=0), 1e-9)
    bright = centre >= np.median(centre)
    gain = np.median(some[:, bright] / centre[bright], axis=1)
    gain = np.where(gain > 0, gain, 1.0)
    typical, change = np.empty_like(phasors.mean[0]), np.empty_like(phasors.mean[0])
    _median_of_sets(phasors.mean, gain, typical, change)
    return typical, change, gain


def amplitude(phasors: Phasors) -> Single:
    """Amplitude of the fringes, grey levels, rms over axes and periods (rows, cols)."""
    return np.asarray(np.sqrt(phasors.power.mean(axis=(0, 1))))


def unmodulated(phasors: Phasors, noise: NoiseModel, mean: Single, rms_amplitude: Single) -> Mask:
    """Pixels without the fringes of every period, or with fringes as weak as from a face or stray light."""
    _, solve = fit_matrices(phasors.sequence.shifts_rad)
    gain = max(float(np.sum(solve[1] ** 2)), float(np.sum(solve[2] ** 2))) / phasors.sequence.repeats
    least = LEAST_SNR**2 * gain * noise.variance(mean)
    weak = np.asarray((phasors.power < least).any(axis=(0, 1)))
    if not weak.all():
        weak |= rms_amplitude < LEAST_AMPLITUDE * np.quantile(rms_amplitude[~weak], 0.9)
    return weak


def disturbed(
    phasors: Phasors, noise: NoiseModel, mean: Single, change: Single, rms_amplitude: Single
) -> Mask:
    """Pixels whose light changed between or within the sets, without margin."""
    _, solve = fit_matrices(phasors.sequence.shifts_rad)
    variance = noise.variance(mean)
    mean_noise = np.sqrt(variance * np.sum(solve[0] ** 2))
    found = (change > SIGMAS * mean_noise) & (change > MEAN_SHARE * mean)
    if phasors.set_degrees > 0:
        misfit = np.sqrt(phasors.worst_scatter)
        limit = np.sqrt(chdtri(phasors.set_degrees, 1e-9) / phasors.set_degrees)
        relative = misfit / np.maximum(mean, 1e-9)
        # harmonics that too few shifts cannot fit are everywhere, a disturbance is local
        usual = 4.0 * float(np.median(relative[rms_amplitude >= np.median(rms_amplitude)]))
        found |= (misfit > limit * np.sqrt(variance)) & (relative > max(MISFIT_SHARE, usual))
    if phasors.sequence.repeats > 1:
        moved_noise = np.sqrt(2.0 * variance * np.sum(solve[1:3] ** 2))
        found |= (phasors.moved > SIGMAS * moved_noise) & (phasors.moved > MOVED_SHARE * rms_amplitude)
    return np.asarray(found)


def with_margin(mask: Mask, reach_px: int = SPREAD_PX) -> Mask:
    """The mask and all pixels within `reach_px` of it."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1,) * 2)
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(np.bool_)


def small_parts(mask: Mask, most_px: int = DEAD_AREA_PX) -> Mask:
    """Connected parts of the mask of at most `most_px` pixels."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] <= most_px
    small[0] = False
    return np.asarray(small[label])


def dimmed(rms_amplitude: Single, weak: Mask) -> Mask:
    """Small parts far dimmer than the fringes around them; weak: pixels without fringes."""
    surrounded = cv2.medianBlur(weak.astype(np.uint8), 5) == 0
    around = cv2.medianBlur(np.ascontiguousarray(rms_amplitude, dtype=np.float32), 5)
    return small_parts((rms_amplitude < DIM_SHARE * around) & surrounded)


def second_reflection(places: Places, usable: Mask, degrees: int, limit_share: float) -> tuple[Single, Mask]:
    """Light of a second reflection relative to the main one (rows, cols), and where it exceeds `limit_share`.

    A second place at distance D turns the phase of period P by share x sin(2 pi D / P) at most: the periods
    then disagree, by share^2 / 2 per phase on average over D. The share follows from the excess of chi^2,
    pooled over `POOL_PX` squared; 0 where it is within two standard deviations of noise. A second place
    nearer than about a third of the shortest period shifts all periods equally, like blur, and is not found.
    """
    if degrees < 1:
        return np.zeros(usable.shape, dtype=np.float32), np.zeros(usable.shape, dtype=np.bool_)
    weight = usable.astype(np.float32)

    def pooled(values: Single) -> Single:
        return np.asarray(cv2.boxFilter(np.where(usable, values, 0).astype(np.float32), -1, (POOL_PX,) * 2))

    count = np.maximum(pooled(weight), 1e-6)
    stiffness = np.maximum(pooled(places.stiffness) / count, 1e-6)
    excess = 2.0 * (pooled(places.chi2) / count - degrees) / stiffness
    unsure = 2.0 * np.sqrt(2.0 * degrees / (count * POOL_PX**2)) / stiffness
    common = pooled((places.chi2 > chdtri(degrees, 0.5)).astype(np.float32)) / count
    real = (excess > 2.0 * unsure) & (count * POOL_PX**2 >= 4)
    share = np.sqrt(np.where(real, np.maximum(excess, 0.0), 0.0)).astype(np.float32)
    proven = (excess > SIGMAS * unsure) & (common > POOL_AGREES) & usable
    return share, _extended(proven & (share > limit_share), proven) & usable


def _extended(found: Mask, proven: Mask) -> Mask:
    """Second reflections above the limit, with the connected parts that appear weaker than they are.

    The distance of two reflections varies over the view; where it is near 0 or near whole periods, the
    periods agree although the light is that of the neighbourhood. A part of which less than `SEED_SHARE` is
    above the limit is above it by noise.
    """
    _, label = cv2.connectedComponents(proven.astype(np.uint8), connectivity=8)
    area = np.maximum(np.bincount(label.ravel()), 1)
    seeded = np.bincount(label.ravel(), weights=found.ravel(), minlength=len(area)) > SEED_SHARE * area
    seeded[0] = False
    reached = (found | seeded[label]).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * POOL_PX + 1,) * 2)
    return cv2.morphologyEx(reached, cv2.MORPH_CLOSE, kernel).astype(np.bool_)


def inconsistent(places: Places, degrees: int, largest_share: float = 0.1) -> Mask:
    """Single pixels whose periods disagree beyond noise, as much as a reflection of `largest_share` does."""
    if degrees < 1:
        return np.zeros(places.chi2.shape, dtype=np.bool_)
    far = places.chi2 > chdtri(degrees, 1e-8)
    return np.asarray(far & (2.0 * (places.chi2 - degrees) > largest_share**2 * places.stiffness))
