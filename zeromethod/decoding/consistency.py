"""Consistency of neighbouring pixels: a rest map is smooth, a wrong order jumps by about a period.

Two tests that use more than the likelihood of a single pixel. *Patches*: pixels are joined to their
neighbours unless they are half a period off the usual step; a patch with such jumps against a larger one is
wrong. *Pixels*: each is compared with the means of opposite neighbours, which no slope affects; the median of
eight such means tolerates three that are wrong.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask

_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 2), (2, -2))
_LEAST_PAIRS = 3


@numba.njit(cache=True)
def _root(parent: Ints, n: int) -> int:
    while parent[n] != n:
        parent[n] = parent[parent[n]]
        n = parent[n]
    return n


@numba.njit(cache=True)
def _patches(x_px: Float, usable: Mask, jump_px: float, steps: Float) -> Ints:
    """Patch of every pixel: the index of its first pixel, -1 where not usable."""
    rows, cols = usable.shape
    parent = np.arange(rows * cols)
    for j in range(rows):
        for i in range(cols):
            for side in range(2):
                b, a = j + side, i + 1 - side
                if b < rows and a < cols and usable[j, i] and usable[b, a]:
                    off = np.abs(x_px[b, a] - x_px[j, i] - steps[side])
                    if off[0] < jump_px and off[1] < jump_px:
                        one, other = _root(parent, j * cols + i), _root(parent, b * cols + a)
                        parent[max(one, other)] = min(one, other)
    label = np.full((rows, cols), -1, dtype=np.int64)
    for j in range(rows):
        for i in range(cols):
            if usable[j, i]:
                label[j, i] = _root(parent, j * cols + i)
    return label


@numba.njit(cache=True)
def _borders_larger(label: Ints, size: Ints) -> Mask:
    """(patches,) whether a patch borders on a larger one."""
    rows, cols = label.shape
    borders = np.zeros(rows * cols, dtype=np.bool_)
    for j in range(rows):
        for i in range(cols):
            for side in range(2):
                b, a = j + side, i + 1 - side
                if b < rows and a < cols:
                    one, other = label[j, i], label[b, a]
                    if one >= 0 and other >= 0 and one != other:
                        borders[one if size[one] < size[other] else other] = True
    return borders


def jumped_patches(lcd_px: Float, usable: Mask, jump_px: float) -> Mask:
    """Pixels of patches that lie a jump (more than `jump_px`, LCD px) away from a larger neighbouring patch.

    lcd_px: (rows, cols, 2). usable: (rows, cols). Isolated patches cannot be judged and are kept.
    """
    steps = np.zeros((2, 2))
    for side, other in enumerate(((slice(None), slice(1, None)), (slice(1, None), slice(None)))):
        before = tuple(slice(None, -1) if part.start else part for part in other)
        both = usable[other] & usable[before]
        if both.any():
            steps[side] = np.median((lcd_px[other] - lcd_px[before])[both], axis=0)
    label = _patches(lcd_px, usable, jump_px, steps)
    size = np.bincount(label[usable], minlength=label.size)
    return np.asarray(_borders_larger(label, size)[label] & usable)


@numba.njit(cache=True)
def _departures(x_px: Float, usable: Mask, pairs: Ints, out: Float) -> None:
    rows, cols = usable.shape
    means = np.empty(len(pairs))
    for j in range(rows):
        for i in range(cols):
            if not usable[j, i]:
                continue
            for k in range(2):
                count = 0
                for n in range(len(pairs)):
                    dj, di = pairs[n, 0], pairs[n, 1]
                    if not (dj <= j < rows - dj and abs(di) <= i < cols - abs(di)):
                        continue
                    if usable[j - dj, i - di] and usable[j + dj, i + di]:
                        means[count] = 0.5 * (x_px[j - dj, i - di, k] + x_px[j + dj, i + di, k])
                        count += 1
                if count >= _LEAST_PAIRS:
                    for n in range(1, count):  # insertion sort: a handful of numbers
                        value = means[n]
                        m = n - 1
                        while m >= 0 and means[m] > value:
                            means[m + 1] = means[m]
                            m -= 1
                        means[m + 1] = value
                    middle = 0.5 * (means[(count - 1) // 2] + means[count // 2])
                    out[j, i, k] = x_px[j, i, k] - middle


def departures(lcd_px: Float, usable: Mask) -> Float:
    """(rows, cols, 2) LCD px deviation of usable pixels from their neighbours; NaN where too few."""
    out = np.full_like(lcd_px, np.nan)
    _departures(lcd_px, usable, np.array(_PAIRS), out)
    return out
