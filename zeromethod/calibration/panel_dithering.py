"""Dithering of a display in time and in space, from the light at the camera."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from zeromethod.arrays import Float, Mask, Single
from zeromethod.calibration.falloff import mean_around
from zeromethod.calibration.panel_faults import SURE_SIGMAS, Fault, FaultCheck, root
from zeromethod.errors import InputError

SLOWEST_CYCLES = 3
"""Of a series of frames: pixels that change more slowly drift."""

FINE_PX = 5
"""Camera px over which a pattern's mean is taken off: shading and viewing angle are smoother."""

_LEAST_PIXELS = 256


def temporal_dithering(
    series: Sequence[NDArray[np.generic]], codes: Sequence[int], grey_per_code: Sequence[float], lit: Mask
) -> FaultCheck:
    """Dithering in time: pixels that swing with a rhythm, each with its own phase, in an unchanged picture.

    series: for each code, (frames, rows, cols) of a uniform pattern, 16 frames at least. grey_per_code: grey
    levels that one code more makes there. Noise is as strong at every frequency; what stands out, in the mean
    over the lit pixels' spectra, does not come from noise. Size: rms of one pixel, grey codes.
    """
    made = []
    for stack, code, step in zip(series, codes, grey_per_code, strict=True):
        size, sigma = (one / step for one in _swing(np.asarray(stack, dtype=np.float32)[:, lit]))
        words = (
            f"at code {code} pixels swing by {size:.2g} grey codes (rms) while the picture does not change"
        )
        made.append(FaultCheck(Fault.TEMPORAL_DITHERING, size, sigma, words))
    return _strongest(made, Fault.TEMPORAL_DITHERING)


def _swing(grey: Single) -> tuple[float, float]:
    """Rms of what stands out of the noise in the spectra of (frames, pixels) grey, and its sigma."""
    frames = len(grey)
    if frames < 16:
        raise InputError(f"dithering: {frames} frames: sixteen or more")
    grey -= grey.mean(axis=0)
    # the backlight's flicker is no dithering
    grey -= grey.mean(axis=1, keepdims=True)
    power = np.zeros(frames // 2 + 1)
    for part in np.array_split(grey, max(1, grey.shape[1] // 4096), axis=1):
        power += np.sum(np.abs(np.fft.rfft(part, axis=0)) ** 2, axis=1)
    power /= grey.shape[1] * frames**2
    share = np.full(len(power), 2.0)
    if frames % 2 == 0:
        share[-1] = 1.0
    power = (power * share)[SLOWEST_CYCLES:]  # variance of each frequency
    share = share[SLOWEST_CYCLES:]
    floor = float(np.median(power / share))
    # |FFT|^2 of noise has as large a standard deviation as mean; at half the frame rate root 2 times it
    spread = floor * share * np.sqrt(2.0 / share) / math.sqrt(grey.shape[1])
    excess = power - floor * share
    lines = excess > 4.0 * spread
    lines[int(np.argmax(excess / spread))] = True
    variance, sigma2 = float(excess[lines].sum()), float(np.sqrt(np.sum(spread[lines] ** 2)))
    # the strongest of n frequencies is as strong as this by chance alone
    if variance <= 4.5 * sigma2:
        return 0.0, math.sqrt(4.5 * sigma2) / SURE_SIGMAS
    return root(variance, sigma2)


def spatial_dithering(
    halves: Sequence[Float],
    codes: Sequence[int],
    grey_per_code: Sequence[float],
    white: Float,
    black: Float,
    lit: Mask,
) -> FaultCheck:
    """Dithering in space: a fine pattern at some grey codes that the white picture does not show.

    halves: for each code, (2, rows, cols): mean of the first and of the second half of its frames. white,
    black: (2, rows, cols) likewise. Pixels that are brighter or dimmer are so at every code, in proportion to
    the light: that is taken off by way of the white. What both halves agree upon is no noise. Size: rms, grey
    codes.
    """
    made = []
    inner = np.asarray(uniform_filter(lit.astype(np.float64), FINE_PX) > 1 - 1e-9)
    if np.count_nonzero(inner) < _LEAST_PIXELS:
        halves, codes, grey_per_code = (), (), ()
    swing = white - black
    for pair, code, step in zip(halves, codes, grey_per_code, strict=True):
        rest = np.empty_like(pair)
        for half in range(2):
            with np.errstate(divide="ignore", invalid="ignore"):  # outside the lit part
                light = mean_around(pair[half] - black[half], lit, FINE_PX)
                light /= mean_around(swing[half], lit, FINE_PX)
                rest[half] = pair[half] - black[half] - light * swing[half]
        agreed = rest[0][inner] * rest[1][inner]
        # smoothing ties neighbours together a little: fewer independent ones than pixels
        sigma2 = 1.5 * float(agreed.std()) / math.sqrt(len(agreed))
        size, sigma = (one / step for one in root(float(agreed.mean()), sigma2))
        words = f"at code {code} the picture has a fine pattern of {size:.2g} grey codes (rms) of its own"
        made.append(FaultCheck(Fault.SPATIAL_DITHERING, size, sigma, words))
    return _strongest(made, Fault.SPATIAL_DITHERING)


def _strongest(made: Iterable[FaultCheck], fault: Fault) -> FaultCheck:
    """The largest that was found, else the surest that was not."""
    unknown = FaultCheck(fault, 0.0, math.inf, "")
    return max(made, key=lambda one: (one.found, one.size if one.found else -one.sigma), default=unknown)
