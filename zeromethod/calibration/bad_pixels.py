"""Camera pixels that behave unlike their neighbours, by reason."""

from __future__ import annotations

import enum
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter, uniform_filter
from scipy.special import chdtri

from zeromethod.arrays import Bytes, Mask
from zeromethod.calibration.photon_transfer import QUANTISATION, PhotonTransfer, Still

NEIGHBOURS_PX = 5

DIM_SHARE = 0.5
"""Of the neighbours' light: what follows it by less, or by twice as much, is no pixel to measure with."""

HOT_SHARE = 0.02
"""Of full scale, above the neighbours in the black picture."""

NOISY_RATIO = 2.0
"""Variance over the model's, beyond what chance does, from which a pixel is noisy (it blinks)."""

_SIGMAS = 6.0
_CHANCE = 1e-7


class BadPixel(enum.IntFlag):
    """Reasons against a camera pixel; several may hold at once."""

    STUCK = 1  # the same grey whatever the light
    HOT = 2  # bright in the dark
    DEAD = 4  # follows the light far less, or far more, than its neighbours; dust, or a dead pixel of the LCD
    NOISY = 8  # blinks


def find_bad_pixels(
    white: Still, black: Still, lit: Mask, noise: PhotonTransfer, stills: Sequence[Still] = ()
) -> Bytes:
    """(rows, cols) `BadPixel`, 0 = sound, from pictures of the white and the black LCD, and more for noise.

    lit: pixels that look at the LCD; what lies beyond is judged by the dark alone.
    """
    reason = np.zeros(lit.shape, dtype=np.uint8)
    full = white.full_grey
    spread = np.sqrt(noise.variance(black.mean) / (black.degrees + 1))
    level = median_filter(black.mean, NEIGHBOURS_PX)
    # the picture's own edges and texture make neighbours differ, too
    texture = 1.4826 * float(np.median(np.abs(black.mean - level)))
    hot = black.mean - level > np.maximum(_SIGMAS * np.maximum(spread, texture), HOT_SHARE * full)
    reason[hot] |= int(BadPixel.HOT)

    swing = white.mean - black.mean
    usual = median_filter(np.where(lit, swing, 0.0), NEIGHBOURS_PX)
    # a pixel that fails is not among those found lit: its neighbours decide
    inside = median_filter(lit.astype(np.uint8), NEIGHBOURS_PX) > 0
    inside &= usual > 0
    sigma = np.sqrt(
        noise.variance(white.mean) / (white.degrees + 1) + noise.variance(black.mean) / (black.degrees + 1)
    )
    apart = np.abs(swing - usual)
    alone = _alone(lit)
    dead = (
        inside
        & alone
        & (apart > _SIGMAS * sigma)
        & ((swing < DIM_SHARE * usual) | (swing > usual / DIM_SHARE))
    )
    reason[dead] |= int(BadPixel.DEAD)
    still_ones = [white, black, *stills]
    degrees = sum(one.degrees for one in still_ones)
    relative = np.sum([one.degrees * one.variance / noise.variance(one.mean) for one in still_ones], axis=0)
    limit = max(NOISY_RATIO, float(chdtri(degrees, _CHANCE)) / degrees)
    reason[relative / degrees > limit] |= int(BadPixel.NOISY)

    # which also makes it seem hot or dead
    stuck = np.all([one.steady for one in still_ones], axis=0) & (swing == 0) & inside
    reason[stuck & (noise.variance(white.mean) > 4 * QUANTISATION)] = int(BadPixel.STUCK)
    return reason


def _alone(lit: Mask) -> Mask:
    """Pixels of which most neighbours are lit: no edge of the lit area runs here."""
    share = uniform_filter(lit.astype(np.float64), NEIGHBOURS_PX, mode="constant")
    return np.asarray(share > 0.8 - 1e-6)
