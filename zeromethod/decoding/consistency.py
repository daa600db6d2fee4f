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

from zeromethod.arrays import Float, Ints, Mask, Single

_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 2), (2, -2))
_LEAST_PAIRS = 3
_SAMPLES = 500


@numba.njit(cache=True)
def _jumps(lcd_px: Float, usable: Mask, usual: Float, jump_px: Float) -> bool:
    """Whether any two neighbours are a jump apart."""
    rows, cols = usable.shape
    for k in range(2):
        for j in range(rows - k):
            found = False
            for i in range(cols - 1 + k):
                b = (j + k, i + 1 - k)
                for axis in range(2):
                    off = abs(lcd_px[b[0], b[1], axis] - lcd_px[j, i, axis] - usual[k, axis])
                    found |= usable[j, i] & usable[b] & (off >= jump_px[axis])
            if found:
                return True
    return False


@numba.njit(cache=True)
def _join(lcd_px: Float, usable: Mask, usual: Float, jump_px: Float, patch: Ints) -> None:
    """Join neighbours that are no jump apart. patch: (pixels,) number of another in it."""
    rows, cols = usable.shape
    for j in range(rows):
        for i in range(cols):
            for k in range(2):
                b = (j + k, i + 1 - k)
                if b[0] >= rows or b[1] >= cols or not (usable[j, i] and usable[b]):
                    continue
                together = True
                for axis in range(2):
                    step = lcd_px[b[0], b[1], axis] - lcd_px[j, i, axis] - usual[k, axis]
                    together &= abs(step) < jump_px[axis]
                if together:
                    first, second = _root(patch, j * cols + i), _root(patch, b[0] * cols + b[1])
                    patch[max(first, second)] = min(first, second)


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
    usual = np.zeros((2, 2))
    for k, (one, other) in enumerate(sides):
        shape = usable[one].shape
        at = np.s_[:: max(1, shape[0] * shape[1] // _SAMPLES)]
        both = usable[one][at] & usable[other][at]
        if both.any():
            usual[k] = np.median(lcd_px[other][at][both] - lcd_px[one][at][both], axis=0)
    if not _jumps(lcd_px, usable, usual, jump_px):
        return np.zeros_like(usable)
    patch: Ints = np.arange(usable.size)
    _join(lcd_px, usable, usual, jump_px, patch)
    patch = _roots(patch).reshape(usable.shape)
    size = np.bincount(patch.ravel(), minlength=usable.size)
    borders = np.zeros(usable.size, dtype=np.bool_)
    for one, other in sides:
        both = usable[one] & usable[other]
        a, b = patch[one][both], patch[other][both]
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
def _means(x_px: Float, usable: Mask, j: int, i: int, pairs: Ints, means: Float) -> int:
    """Means (2, pairs) of the places of opposite neighbours of a pixel; how many there are."""
    rows, cols = usable.shape
    count = 0
    for n in range(len(pairs)):
        dj, di = pairs[n, 0], pairs[n, 1]
        if not (dj <= j < rows - dj and abs(di) <= i < cols - abs(di)):
            continue
        if usable[j - dj, i - di] and usable[j + dj, i + di]:
            means[0, count] = 0.5 * (x_px[j - dj, i - di, 0] + x_px[j + dj, i + di, 0])
            means[1, count] = 0.5 * (x_px[j - dj, i - di, 1] + x_px[j + dj, i + di, 1])
            count += 1
    return count


@numba.njit(cache=True)
def _count_close(x: Float, limit: Float, j: int, pairs: Ints, close: Single) -> None:
    """Pairs of neighbours, of every pixel of row j, whose mean lies within the limit; axes alternate.

    x: (rows, 2 cols), NaN where not usable. limit: (2 cols,). close: (2 cols,). No branches: it vectorises.
    """
    close[:] = 0
    for n in range(len(pairs)):
        dj, di = pairs[n, 0], 2 * pairs[n, 1]
        if not dj <= j < len(x) - dj:
            continue
        edge, size = abs(di), len(close) - 2 * abs(di)
        before, after = x[j - dj][edge - di :], x[j + dj][edge + di :]
        here, within, add = x[j][edge:], limit[edge:], close[edge:]
        for m in range(size):
            off = abs(0.5 * (before[m] + after[m]) - here[m])
            add[m] += np.float32(1.0) if off < within[m] else np.float32(0.0)


@numba.njit(cache=True)
def _compare(
    x_px: Float,
    sigma_px: Float,
    bounds: tuple[float, float],
    half_px: Float,
    usable: Mask,
    pairs: Ints,
    masks: tuple[Mask, Mask, Mask],
) -> None:
    rows, cols = usable.shape
    means = np.empty((2, len(pairs)))
    known, limit, close = np.empty((rows, 2 * cols)), np.empty(2 * cols), np.empty(2 * cols, np.float32)
    for j in range(rows):
        for i in range(cols):
            known[j, 2 * i] = x_px[j, i, 0] if usable[j, i] else np.nan
            known[j, 2 * i + 1] = x_px[j, i, 1] if usable[j, i] else np.nan
    most = len(pairs) // 2 + 1  # the median of all cannot lie farther
    outlying, far, confirmed = masks
    for j in range(rows):
        for i in range(cols):
            for k in range(2):
                limit[2 * i + k] = min(max(bounds[0] * sigma_px[j, i, k], bounds[1]), half_px[k])
        _count_close(known, limit, j, pairs, close)
        for i in range(cols):
            if not usable[j, i]:
                continue
            confirmed[j, i] = True
            if close[2 * i] >= most and close[2 * i + 1] >= most:
                continue
            count = _means(x_px, usable, j, i, pairs, means)
            if count < _LEAST_PAIRS:
                confirmed[j, i] = False
                continue
            for k in range(2):
                for n in range(count):
                    insert_sorted(means[k], n, means[k, n])
                off = abs(x_px[j, i, k] - 0.5 * (means[k, (count - 1) // 2] + means[k, count // 2]))
                outlying[j, i] |= off > max(bounds[0] * sigma_px[j, i, k], bounds[1])
                far[j, i] |= off > half_px[k]
                confirmed[j, i] &= off < half_px[k]


def compare_neighbours(
    lcd_px: Float, usable: Mask, sigma_px: Float, bounds: tuple[float, float], half_px: Float
) -> tuple[Mask, Mask, Mask]:
    """Usable pixels whose place is off the median of their neighbours' means, and those that it confirms.

    sigma_px: (rows, cols, 2). bounds: sigmas, and px, both of which a pixel must be off along an axis to
    count as off. half_px: (2,) half a shortest period. Returns the pixels that are off, those off by more
    than `half_px`, and those off by less along both.
    """
    outlying, far, confirmed = (np.zeros_like(usable) for _ in range(3))
    _compare(lcd_px, sigma_px, bounds, half_px, usable, np.array(_PAIRS), (outlying, far, confirmed))
    return outlying, far, confirmed
