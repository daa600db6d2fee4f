"""The camera's noise against its signal, by differences of frames of the same picture.

variance = read_grey^2 + (grey - black_grey) / electrons_per_grey, plus 1/12 for rounding to whole grey
levels, as `[camera.noise]` has it. Light alone gives the line's slope and its height, but not where on it the
camera's black lies: read noise and black level are known within bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

from zeromethod.arrays import Float, Mask
from zeromethod.calibration.falloff import mean_around
from zeromethod.errors import InputError, MeasurementError

QUANTISATION = 1.0 / 12.0
"""Variance of rounding to whole grey levels."""

LIGHT_SHARE = 0.05
"""Of full scale: what the greys must span before a slope is fitted."""

_BINS = 4
"""Classes of like grey in each picture: light falls off over the view."""

_COMMON_PIXELS = 20000
"""Enough to find how a frame differs as a whole."""

_AROUND_PX = 9
_LEAST_PIXELS = 64

_CEILING_SDS = 5.0
"""Nearer than this to full scale, noise is cut off."""

_CLIPPED_SHARE = 0.01
"""Of the pixels at grey 0 in the dark, from which the black level is worth a word."""

_FINE_SD = 0.35
"""Noise, grey levels, below which rounding is no noise of its own, and means are good to some tenths only."""

_Z = np.linspace(-3.0, 8.0, 1101)
_DENSITY = np.exp(-0.5 * _Z**2) / np.sqrt(2.0 * np.pi)
_MEAN = _Z * ndtr(_Z) + _DENSITY
_SD = np.sqrt((_Z**2 + 1) * ndtr(_Z) + _Z * _DENSITY - _MEAN**2)


@dataclass(frozen=True)
class Still:
    """Frames of one picture that stood still.

    mean: (rows, cols). variance: (rows, cols) of a single frame, what all pixels share taken out. degrees: of
    freedom of each pixel's variance. steady: (rows, cols) pixels whose grey is the same in every frame.
    level: (frames,) mean grey of the lit pixels. floor_share: readings at grey 0. full_grey: the camera's
    ceiling.
    """

    mean: Float
    variance: Float
    degrees: int
    steady: Mask
    level: Float
    floor_share: float
    full_grey: float


def still(frames: Sequence[NDArray[np.generic]] | NDArray[np.generic], lit: Mask, full_grey: float) -> Still:
    """Mean and variance of (frames, rows, cols) grey levels, two frames or more.

    lit: pixels by which a frame is judged as a whole (a flickering backlight is no noise of the camera):
    by a constant and in proportion to the light.
    """
    stack = np.asarray(frames)
    if stack.ndim != 3 or len(stack) < 2 or stack.shape[1:] != lit.shape:
        raise InputError(f"frames: shape {stack.shape}, lit {lit.shape}: two or more of (rows, cols)")
    mean = stack.mean(axis=0, dtype=np.float64)
    used = np.flatnonzero(lit if np.count_nonzero(lit) >= _LEAST_PIXELS else np.ones_like(lit))
    level = np.array([float(frame.reshape(-1)[used].mean(dtype=np.float64)) for frame in stack])
    few = used[:: max(1, len(used) // _COMMON_PIXELS)]
    middle = mean.reshape(-1)[few].mean()
    # noise of a frame and of the mean that holds it do not go together once the mean is taken off
    design = np.linalg.pinv(
        np.stack([np.ones(len(few)), mean.reshape(-1)[few] - middle], axis=-1), rcond=1e-6
    )
    variance = np.zeros_like(mean)
    for frame in stack:
        apart = frame - mean
        offset, gain = design @ apart.reshape(-1)[few]
        apart -= offset + gain * (mean - middle)
        variance += apart**2
    return Still(
        mean=mean,
        variance=variance / (len(stack) - 1),
        degrees=len(stack) - 1,
        steady=np.asarray((stack == stack[0]).all(axis=0)),
        level=level,
        floor_share=float(np.mean(stack <= 0)),
        full_grey=full_grey,
    )


def unclipped_mean(mean: Float, sd: Float | float) -> Float:
    """Mean of normal noise of known standard deviation whose mean, cut off at 0, was measured."""
    spread = np.broadcast_to(np.maximum(sd, 1e-9), np.shape(mean))
    z = mean / spread
    return np.where(z > 6.0, mean, spread * np.interp(z, _MEAN, _Z))


def unclipped(mean: float, variance: float) -> tuple[float, float]:
    """Mean and variance of normal noise of which, rounded and cut off at 0, both were measured.

    A camera whose black level is set to 0 or near it loses the lower half of its noise. The variance found
    counts rounding as `QUANTISATION`, as that of noise which is not cut off does.
    """
    if variance <= 0 or mean <= 0 or mean > 6.0 * math.sqrt(variance):
        return mean, variance
    # from noise that is cut off but not rounded, which near the black level is half a percent off
    z = float(np.interp(mean / math.sqrt(variance), _MEAN / _SD, _Z))
    start_sd = math.sqrt(variance) / float(np.interp(z, _Z, _SD))
    scale = math.sqrt(variance)

    def rest(terms: Float) -> Float:
        seen_mean, seen_variance = _rounded_and_cut(terms[0] * scale, math.exp(terms[1]))
        return np.array([(seen_mean - mean) / scale, (seen_variance - variance) / variance])

    found = least_squares(rest, np.array([z * start_sd / scale, math.log(start_sd)]), x_scale=0.1)
    if np.max(np.abs(found.fun)) > 1e-6:
        return z * start_sd, start_sd**2
    return float(found.x[0]) * scale, math.exp(2 * float(found.x[1])) + QUANTISATION


def _rounded_and_cut(mean: float, sd: float) -> tuple[float, float]:
    """Mean and variance of normal noise that is rounded to whole grey levels, those below 0 to 0."""
    level = np.arange(1.0, max(mean, 0.0) + 9.0 * sd + 3.0)
    above = ndtr((mean - level + 0.5) / sd)
    first = float(above.sum())
    return first, float((2.0 * level - 1.0) @ above) - first**2


@dataclass(frozen=True)
class BlackLevel:
    """The camera's grey without light: anywhere from low to high, evenly.

    grey, sigma: the middle, and the standard deviation of that.
    """

    grey: float
    sigma: float
    low: float
    high: float


@dataclass(frozen=True)
class PhotonTransfer:
    """Noise as `[camera.noise]` has it, with standard deviations.

    electrons_per_grey: None where noise does not rise with the light. slope, at_zero: of the line
    variance = at_zero + slope x grey, rounding included: known well whatever is known of the black level.
    chi2: per degree of freedom; above 1, sigmas are widened by its root. points: (n, 3) grey, variance,
    sigma. notes: what is wrong or unknown.
    """

    read_grey: float
    read_sigma: float
    electrons_per_grey: float | None
    electrons_sigma: float
    black: BlackLevel
    slope: float
    at_zero: float
    chi2: float
    points: Float
    notes: tuple[str, ...]

    def variance(self, grey: Float | float) -> Float:
        """Variance of one reading at a grey level, rounding included."""
        return np.maximum(self.at_zero + self.slope * np.asarray(grey, dtype=np.float64), QUANTISATION)

    def rig_values(self) -> dict[str, float]:
        """Keys and values for `save_values`."""
        values = {
            "camera.noise.read_grey": self.read_grey,
            "camera.noise.black_grey": max(self.black.grey, 0.0),
        }
        if self.electrons_per_grey is not None:
            values["camera.noise.electrons_per_grey"] = self.electrons_per_grey
        return {key: float(f"{value:.5g}") for key, value in values.items()}


def measure_noise(stills: Sequence[Still], lit: Mask, bad: Mask | None = None) -> PhotonTransfer:
    """Noise against signal.

    stills: pictures of several brightnesses, the black LCD among them. bad: pixels to leave out. Raises
    MeasurementError where too little can be used.
    """
    sound = np.ones_like(lit) if bad is None else ~bad
    points = np.concatenate([_points(one, lit & sound) for one in stills] or [np.empty((0, 3))])
    if len(points) < 3:
        raise MeasurementError(
            "noise: the frames are too dark, too bright or too few: change the exposure until white stays "
            "below full scale"
        )
    sloped = float(np.ptp(points[:, 0])) > LIGHT_SHARE * stills[0].full_grey
    line, covariance, chi2 = _line(points, sloped)
    grey, variance, sigma = points[int(np.argmin(points[:, 0]))]
    # a grey's own error: its noise, over as many readings as its variance came from
    error = 0.05 + 3.0 * float(sigma / math.sqrt(2.0 * max(variance, QUANTISATION)))
    black = _bounds(line, covariance, float(grey) + error)
    read, read_sigma = _read(line, covariance, black)
    rising = sloped and line[1] > 2 * math.sqrt(covariance[1, 1])
    electrons = 1.0 / float(line[1]) if rising else None
    electrons_sigma = math.sqrt(covariance[1, 1]) / float(line[1]) ** 2 if rising else float("nan")
    darkest = min(stills, key=lambda one: float(one.mean.mean()))
    notes = _notes(black, darkest, sloped, chi2, read)
    slope, at_zero = float(line[1]), float(line[0])
    return PhotonTransfer(
        read, read_sigma, electrons, electrons_sigma, black, slope, at_zero, chi2, points, notes
    )


def _notes(black: BlackLevel, darkest: Still, sloped: bool, chi2: float, read: float) -> tuple[str, ...]:
    """What is wrong or unknown, for a person."""
    notes = [
        f"black level: between {black.low:.3g} and {black.high:.3g} grey levels, read noise accordingly: the "
        "camera's black cannot be separated from light that the black LCD and the room give"
    ]
    if darkest.floor_share > _CLIPPED_SHARE:
        notes.append(
            f"black level: {100 * darkest.floor_share:.0f} % of the readings of the darkest frames are 0, "
            "where noise is cut off: raise the camera's black level (offset) to four times its read noise"
        )
    if not sloped:
        notes.append("noise: all frames are equally dark: how noise rises with light is not known")
    elif chi2 > 3.0:
        notes.append(
            f"noise: it is no straight line in the light (chi-square {chi2:.1f} per degree of freedom): a "
            "camera that sharpens, denoises or applies a gamma, or an LCD that dithers: switch that off"
        )
    if read**2 + QUANTISATION < _FINE_SD**2:
        notes.append("noise: near the rounding to whole grey levels: its size in the dark is uncertain")
    return tuple(notes)


def _points(one: Still, chosen: Mask) -> Float:
    """(n, 3) grey, variance, relative weight (degrees of freedom) of classes of like grey."""
    mean, variance = one.mean[chosen], one.variance[chosen]
    if len(mean) < _LEAST_PIXELS:
        return np.empty((0, 3))
    bins = min(_BINS, len(mean) // _LEAST_PIXELS)
    # by the light around, as a pixel's own mean holds its noise
    light = mean_around(one.mean, chosen, _AROUND_PX)[chosen]
    ends = [part[0] for part in np.array_split(np.arange(len(light)), bins)[1:]]
    order = np.argpartition(light, ends) if ends else np.arange(len(light))
    made = []
    for part in np.split(order, ends):
        grey, scatter = unclipped(float(mean[part].mean()), float(variance[part].mean()))
        if one.full_grey - grey > _CEILING_SDS * math.sqrt(max(scatter, QUANTISATION)):
            made.append((grey, scatter, float(one.degrees * len(part))))
    return np.array(made).reshape(-1, 3)


def _line(points: Float, sloped: bool) -> tuple[Float, Float, float]:
    """Variance at grey 0 and its slope, their covariance, chi-square per degree; fills in points' sigma."""
    grey, variance, degrees = points.T
    design = np.stack([np.ones_like(grey), grey if sloped else np.zeros_like(grey)], axis=-1)
    model = np.maximum(variance, QUANTISATION)
    line = np.zeros(2)
    sigma = model
    for _ in range(4):
        sigma = model * np.sqrt(2.0 / degrees)
        line = np.linalg.lstsq(design / sigma[:, None], variance / sigma, rcond=1e-12)[0]
        model = np.maximum(design @ line, 0.5 * QUANTISATION)
    weighted = design / sigma[:, None]
    covariance = np.linalg.pinv(weighted.T @ weighted, rcond=1e-14)
    free = len(grey) - (2 if sloped else 1)
    chi2 = float(np.sum(((variance - design @ line) / sigma) ** 2)) / max(free, 1)
    points[:, 2] = sigma
    return line, covariance * max(chi2, 1.0), chi2


def _bounds(line: Float, covariance: Float, darkest: float) -> BlackLevel:
    """Black level: no read noise at one end, no light in the black LCD at the other."""
    high = max(darkest, 0.0)
    low = 0.0
    if line[1] > 2 * math.sqrt(covariance[1, 1]):
        low = min(max((QUANTISATION - float(line[0])) / float(line[1]), 0.0), high)
    return BlackLevel(0.5 * (low + high), (high - low) / math.sqrt(12.0), low, high)


def _read(line: Float, covariance: Float, black: BlackLevel) -> tuple[float, float]:
    """Read noise at the black level, rounding taken off, and its standard deviation."""
    at = np.array([1.0, black.grey])
    variance = float(at @ line) - QUANTISATION
    sigma2 = math.sqrt(float(at @ covariance @ at) + float(line[1] * black.sigma) ** 2)
    read = math.sqrt(max(variance, 0.0))
    # linear in the variance, not in its root, which has no slope at 0
    upper = math.sqrt(max(variance, 0.0) + sigma2)
    return read, min(sigma2 / (2 * read), upper) if read > 0 else upper
