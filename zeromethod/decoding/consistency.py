"""Consistency of neighbouring pixels: a rest map is smooth, a wrong order jumps by about a period.

Two tests that use more than the likelihood of a single pixel. *Patches*: pixels are joined to their
neighbours unless they are half a period off the usual step; a patch with such jumps against a larger one is
wrong. *Pixels*: each is compared with the means of opposite neighbours, which no slope affects; the median of
eight such means tolerates three that are wrong.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from zeromethod.arrays import Float, Ints, Mask

_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (2, 2), (2, -2))
_LEAST_PAIRS = 3


def jumped_patches(lcd_px: Float, usable: Mask, jump_px: float) -> Mask:
    """Pixels of patches that lie a jump (more than `jump_px`, LCD px) away from a larger neighbouring patch.

    lcd_px: (rows, cols, 2). usable: (rows, cols). Isolated patches cannot be judged and are kept.
    """
    number = np.arange(usable.size).reshape(usable.shape)
    pairs, joined = [], []
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = usable[one] & usable[other]
        step = (lcd_px[other] - lcd_px[one])[both]
        usual = np.median(step, axis=0) if len(step) else 0.0
        pairs.append(np.stack([number[one][both], number[other][both]]))
        joined.append((np.abs(step - usual) < jump_px).all(axis=-1))
    first, second = np.concatenate(pairs, axis=1)
    together = np.concatenate(joined)
    edges = coo_array((together[together], (first[together], second[together])), (usable.size,) * 2)
    _, patch = connected_components(edges, directed=False)
    size = np.bincount(patch)
    a, b = patch[first], patch[second]
    smaller = np.where(size[a] < size[b], a, b)[a != b]
    borders = np.zeros(len(size), dtype=np.bool_)
    borders[smaller] = True
    return np.asarray(borders[patch].reshape(usable.shape) & usable)


@numba.njit(cache=True)
def insert_sorted(values: Float, count: int, new: float) -> None:
    """Insert a number into the first `count` sorted `values`: a handful, for a median."""
    n = count - 1
    while n >= 0 and values[n] > new:
        values[n + 1] = values[n]
        n -= 1
    values[n + 1] = new


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
                        mean = 0.5 * (x_px[j - dj, i - di, k] + x_px[j + dj, i + di, k])
                        insert_sorted(means, count, mean)
                        count += 1
                if count >= _LEAST_PAIRS:
                    middle = 0.5 * (means[(count - 1) // 2] + means[count // 2])
                    out[j, i, k] = x_px[j, i, k] - middle


def departures(lcd_px: Float, usable: Mask) -> Float:
    """(rows, cols, 2) LCD px deviation of usable pixels from their neighbours; NaN where too few."""
    out = np.full_like(lcd_px, np.nan)
    _departures(lcd_px, usable, np.array(_PAIRS), out)
    return out
