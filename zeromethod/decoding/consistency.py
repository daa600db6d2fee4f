"""Consistency of neighbouring pixels: a rest map is smooth, a wrong order jumps by about a period.

Two tests that use more than the likelihood of a single pixel. *Patches*: pixels are joined to their
neighbours unless they are half a period off the usual step; a patch with such jumps against a larger one is
wrong. *Pixels*: each is compared with the means of opposite neighbours, which no slope affects; the median of
eight such means tolerates three that are wrong.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask

_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 2), (2, -2))
_LEAST_PAIRS = 3
_SAMPLES = 500


def jumped_patches(lcd_px: Float, usable: Mask, jump_px: Float) -> Mask:
    """Pixels of patches that lie a jump away from a larger neighbouring patch.

    lcd_px: (rows, cols, 2). jump_px: (2,) LCD px. usable: (rows, cols). Isolated patches cannot be judged
    and are kept.
    """
    sides: tuple[Any, Any] = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
    usual = np.zeros((2, 2))
    for k, (one, other) in enumerate(sides):
        shape = usable[one].shape
        at = np.s_[:: max(1, shape[0] * shape[1] // _SAMPLES)]
        both = usable[one][at] & usable[other][at]
        if both.any():
            usual[k] = np.median(lcd_px[other][at][both] - lcd_px[one][at][both], axis=0)
    # pixels, with what joins neighbours between them: all but jumps
    rows, cols = usable.shape
    joined = np.zeros((2 * rows - 1, 2 * cols - 1), np.uint8)
    joined[::2, ::2] = usable
    jumps = False
    for k, (one, other) in enumerate(sides):
        off = np.abs(lcd_px[other] - lcd_px[one] - usual[k])
        both = usable[one] & usable[other]
        joined[k::2, 1 - k :: 2] = both & (off < jump_px).all(axis=-1)
        jumps |= bool((both & (off >= jump_px).any(axis=-1)).any())
    if not jumps:
        return np.zeros_like(usable)
    patch = cv2.connectedComponents(joined, connectivity=4)[1][::2, ::2]
    size = np.bincount(patch.ravel())
    borders = np.zeros(len(size), dtype=np.bool_)
    for one, other in sides:
        both = usable[one] & usable[other]
        a, b = patch[one][both], patch[other][both]
        borders[np.where(size[a] < size[b], a, b)[a != b]] = True
    return np.asarray(borders[patch] & usable)


def compare_neighbours(
    lcd_px: Float, usable: Mask, sigma_px: Float, bounds: tuple[float, float], half_px: Float
) -> tuple[Mask, Mask, Mask]:
    """Usable pixels whose place is off the median of their neighbours' means, and those that it confirms.

    sigma_px: (rows, cols, 2). bounds: sigmas, and px, both of which a pixel must be off along an axis to
    count as off. half_px: (2,) half a shortest period. Returns the pixels that are off, those off by more
    than `half_px`, and those off by less along both.
    """
    rows, cols = usable.shape
    edge = int(np.abs(_PAIRS).max())
    bound = np.maximum(bounds[0] * sigma_px, bounds[1])
    known = [
        np.pad(np.where(usable, lcd_px[..., axis], np.nan), edge, constant_values=np.nan) for axis in range(2)
    ]
    # where most of all pairs agree with a pixel, so does their median
    agree = usable.copy()
    for axis, x in enumerate(known):
        here, limit = lcd_px[..., axis], np.minimum(bound[..., axis], half_px[axis])
        close = np.zeros(usable.shape, np.int8)
        for dj, di in _PAIRS:
            before = x[edge - dj : edge - dj + rows, edge - di : edge - di + cols]
            after = x[edge + dj : edge + dj + rows, edge + di : edge + di + cols]
            close += np.abs(0.5 * (before + after) - here) < limit
        agree &= close > len(_PAIRS) // 2
    j, i = np.nonzero(usable & ~agree)
    outlying, far, confirmed = np.zeros_like(usable), np.zeros_like(usable), usable.copy()
    for axis, x in enumerate(known):
        down, right = np.array(_PAIRS).T[..., None]
        before, after = x[j + edge - down, i + edge - right], x[j + edge + down, i + edge + right]
        means = np.sort(0.5 * (before + after), axis=0)  # NaN last
        count = np.count_nonzero(~np.isnan(means), axis=0)
        some, each = count >= _LEAST_PAIRS, np.arange(len(j))
        median = 0.5 * (means[(count - 1) // 2, each] + means[count // 2, each])
        off = np.abs(lcd_px[j, i, axis] - median)
        outlying[j, i] |= some & (off > bound[j, i, axis])
        far[j, i] |= some & (off > half_px[axis])
        confirmed[j, i] &= some & (off < half_px[axis])
    return outlying, far, confirmed
