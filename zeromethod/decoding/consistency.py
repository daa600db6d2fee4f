"""Consistency of neighbouring pixels: a rest map is smooth, a wrong order jumps by about a period.

Two tests that use more than the likelihood of a single pixel. *Patches*: pixels are joined to their
neighbours unless they are half a period off the usual step; a patch with such jumps against a larger one is
wrong. *Pixels*: each is compared with the means of opposite neighbours, which no slope affects; the median of
eight such means tolerates three that are wrong.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask

_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 2), (2, -2))
_LEAST_PAIRS = 3
_SAMPLES = 20_000


@numba.njit(cache=True)
def _jumps(lcd_px: Float, usable: Mask, usual: Float, jump_px: Float, patch: Ints) -> bool:
    """Join neighbours that are no jump apart; whether any are. patch: (pixels,) number of another in it."""
    rows, cols = usable.shape
    found = False
    for j in range(rows):
        for i in range(cols):
            if not usable[j, i]:
                continue
            for k in range(2):
                b, a = (j + k, i + 1 - k), (j, i)
                if b[0] >= rows or b[1] >= cols or not usable[b]:
                    continue
                together = True
                for axis in range(2):
                    step = lcd_px[b[0], b[1], axis] - lcd_px[a[0], a[1], axis] - usual[k, axis]
                    together &= abs(step) < jump_px[axis]
                if not together:
                    found = True
                    continue
                first, second = _root(patch, a[0] * cols + a[1]), _root(patch, b[0] * cols + b[1])
                patch[max(first, second)] = min(first, second)
    return found


@numba.njit(cache=True, inline="always")
def _root(patch: Ints, pixel: int) -> int:
    while patch[pixel] != pixel:
        patch[pixel] = patch[patch[pixel]]
        pixel = patch[pixel]
    return pixel


def jumped_patches(lcd_px: Float, usable: Mask, jump_px: Float) -> Mask:
    """Pixels of patches that lie a jump away from a larger neighbouring patch.

    lcd_px: (rows, cols, 2). jump_px: (2,) LCD px. usable: (rows, cols). Isolated patches cannot be judged
    and are kept.
    """
    sides: tuple[Any, Any] = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
    both = [usable[one] & usable[other] for one, other in sides]
    usual = np.zeros((2, 2))
    for k, (one, other) in enumerate(sides):
        index = np.flatnonzero(both[k])
        if len(index):
            at = np.unravel_index(index[:: max(1, len(index) // _SAMPLES)], both[k].shape)
            usual[k] = np.median(lcd_px[other][at] - lcd_px[one][at], axis=0)
    patch: Ints = np.arange(usable.size)
    if not _jumps(lcd_px, usable, usual, jump_px, patch):
        return np.zeros_like(usable)
    patch = _roots(patch).reshape(usable.shape)
    size = np.bincount(patch.ravel(), minlength=usable.size)
    borders = np.zeros(usable.size, dtype=np.bool_)
    for k, (one, other) in enumerate(sides):
        a, b = patch[one][both[k]], patch[other][both[k]]
        borders[np.where(size[a] < size[b], a, b)[a != b]] = True
    return np.asarray(borders[patch] & usable)


@numba.njit(cache=True)
def _roots(patch: Ints) -> Ints:
    for pixel in range(len(patch)):
        patch[pixel] = _root(patch, pixel)
    return patch


@numba.njit(cache=True)
def insert_sorted(values: Float, count: int, new: float) -> None:
    """Insert a number into the first `count` sorted `values`: a handful, for a median."""
    n = count - 1
    while n >= 0 and values[n] > new:
        values[n + 1] = values[n]
        n -= 1
    values[n + 1] = new


@numba.njit(cache=True)
def _compare(
    x_px: Float, limit_px: Float, half_px: Float, usable: Mask, pairs: Ints, masks: tuple[Mask, Mask, Mask]
) -> None:
    rows, cols = usable.shape
    means = np.empty(len(pairs))
    most = len(pairs) // 2 + 1
    outlying, far, confirmed = masks
    for j in range(rows):
        for i in range(cols):
            if not usable[j, i]:
                continue
            confirmed[j, i] = True
            for k in range(2):
                x, limit = x_px[j, i, k], min(limit_px[j, i, k], half_px[k])
                count = close = 0
                for n in range(len(pairs)):
                    dj, di = pairs[n, 0], pairs[n, 1]
                    if not (dj <= j < rows - dj and abs(di) <= i < cols - abs(di)):
                        continue
                    if usable[j - dj, i - di] and usable[j + dj, i + di]:
                        means[count] = 0.5 * (x_px[j - dj, i - di, k] + x_px[j + dj, i + di, k])
                        close += abs(means[count] - x) < limit
                        count += 1
                        if close == most:
                            break
                if close == most:  # the median of all cannot lie farther
                    continue
                if count < _LEAST_PAIRS:
                    confirmed[j, i] = False
                    continue
                for n in range(count):
                    insert_sorted(means, n, means[n])
                off = abs(x - 0.5 * (means[(count - 1) // 2] + means[count // 2]))
                outlying[j, i] |= off > limit_px[j, i, k]
                far[j, i] |= off > half_px[k]
                confirmed[j, i] &= off < half_px[k]


def compare_neighbours(
    lcd_px: Float, usable: Mask, limit_px: Float, half_px: Float
) -> tuple[Mask, Mask, Mask]:
    """Usable pixels whose place is off the median of their neighbours' means, and those that it confirms.

    limit_px: (rows, cols, 2). half_px: (2,) half a shortest period. Returns the pixels that are off by more
    than `limit_px` along an axis, those off by more than `half_px`, and those off by less along both.
    """
    outlying, far, confirmed = (np.zeros_like(usable) for _ in range(3))
    _compare(lcd_px, limit_px, half_px, usable, np.array(_PAIRS), (outlying, far, confirmed))
    return outlying, far, confirmed
