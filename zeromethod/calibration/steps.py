"""Where a bright part of a picture ends at a sharp step, line by line, to parts of a pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask, Single

LIT_SHARE = 0.35
"""Of the usual level, from which a pixel counts as lit."""

DARK_SHARE = 0.25
"""Of the level before the step, which the level past it must stay below."""

MOST_WIDTH_PX = 8.0
"""Width of a step, from 80 to 20 %: a gradual loss is wider."""

LEAST_VALID = 0.7
"""Share of the pixels before the step that must be valid."""

_NEAR, _FAR = 4, 13
"""The levels are taken from _NEAR to _FAR px before and past the step."""
_LEAST_DARK = 5


def steps_down(
    level: Single, valid: Mask, middle: Float, half_width: float, outwards: int, usual: float
) -> tuple[Float, Float]:
    """Find the last step from bright to dark on every line, within `half_width` px of `middle`.

    level, valid: (lines, n). middle: (lines,) px. outwards: +1 or -1, the way from bright to dark. usual:
    level of what is bright.

    Returns
    -------
    place: (lines,) px at which the level is half way between those before and past the step; NaN where
    there is no such step: nothing lit or valid before it, light past it, fewer than 5 px past it, or a
    gradual loss.
    width: (lines,) px from 80 to 20 %.
    """
    size = level.shape[1]
    if outwards < 0:
        place, width = steps_down(level[:, ::-1], valid[:, ::-1], size - 1 - middle, half_width, 1, usual)
        return size - 1 - place, width
    column = np.arange(size)
    near = np.abs(column - middle[:, None]) <= half_width
    lit = near & (level > LIT_SHARE * usual)
    last = size - 1 - np.argmax(lit[:, ::-1], axis=1)
    offset = np.arange(-_FAR + 1, _FAR)
    at = last[:, None] + offset
    within = (at >= 0) & (at < size)
    at = np.clip(at, 0, size - 1)
    strip = np.where(within, np.take_along_axis(level, at, axis=1).astype(np.float64), np.nan)
    sound = np.take_along_axis(valid, at, axis=1) & within
    before, past = offset <= -_NEAR, offset >= _NEAR
    enough = lit.any(axis=1) & within[:, before].all(axis=1)
    enough &= np.count_nonzero(within & (offset > 0), axis=1) >= _LEAST_DARK
    enough &= sound[:, before].mean(axis=1) >= LEAST_VALID
    place, width = np.full(len(level), np.nan), np.full(len(level), np.nan)
    if not enough.any():
        return place, width
    high = np.median(strip[enough][:, before], axis=1)
    low = np.nanmedian(strip[enough][:, past], axis=1)
    crossings = [_crossing(strip[enough], offset, low + share * (high - low)) for share in (0.8, 0.5, 0.2)]
    wide = crossings[2] - crossings[0]
    sharp = (high > LIT_SHARE * usual) & (low < DARK_SHARE * high) & (wide <= MOST_WIDTH_PX)
    place[enough] = np.where(sharp, last[enough] + crossings[1], np.nan)
    width[enough] = np.where(sharp, wide, np.nan)
    return place, width


def _crossing(strip: Float, offset: NDArray[np.int_], level: Float) -> Float:
    """Offset (lines,) at which strips fall below `level` (lines,) for good; NaN where they do not."""
    above = strip >= level[:, None]
    index = strip.shape[1] - 1 - np.argmax(above[:, ::-1], axis=1)
    line = np.arange(len(strip))
    following = np.minimum(index + 1, strip.shape[1] - 1)
    here, there = strip[line, index], strip[line, following]
    known = above.any(axis=1) & (following > index) & np.isfinite(there)
    with np.errstate(invalid="ignore", divide="ignore"):
        part = (here - level) / (here - there)
    return np.where(known, offset[index] + part, np.nan)
