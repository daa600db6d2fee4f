"""How noise of depth grows with that of the slopes around, octave by octave of their distance."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.rounding import REORDERED
from zeromethod.surface.node_passes import dot

_BOXES = (1, 3, 7, 15, 31, 63)
_EVEN = 0.02


def grown_by(power: Float, kept: Float, both: Mask, known: Known, anchor: Float) -> Float | float:
    """How the variance of depth has grown with slopes' noise, (rows, cols) or the same everywhere.

    power, kept: of the noise now and before, (rows, cols), both known on these nodes, whose `Known` is
    given. anchor: weights.
    """
    ratio, middle, uneven = _ratios(power, kept, both)
    if uneven < _EVEN:
        return middle
    values, total = np.empty(known.shape), np.zeros(ratio.shape)
    _sums(ratio, values)
    _add_box_means(values, known.shares, known.boxes, middle, total)
    at_anchor = float(dot(anchor, total) / max(float(anchor.sum()), 1e-30))
    return 0.5 * (total + at_anchor)


class Known(NamedTuple):
    """Boxes around each node of a mask, and 1 over the number of its nodes in each, over that of the boxes.

    shares: (boxes, rows, cols); 0 where a box has none. shape: of `_sums`, with half the last box around.
    """

    boxes: NDArray[np.intp]
    shares: Float
    shape: tuple[int, int]

    @classmethod
    def of(cls, nodes: Mask) -> Known:
        """For nodes (rows, cols)."""
        rows, cols = nodes.shape
        boxes = np.array([n for n in _BOXES if n <= max(nodes.shape)])
        sums = np.empty((rows + 1, cols + 1 + 2 * int(boxes[-1] // 2)))
        _sums(nodes.astype(np.float64), sums)
        shares = np.empty((len(boxes), rows, cols))
        _shares(sums, boxes, shares)
        return cls(boxes, shares, sums.shape)


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _ratios(now: Float, kept: Float, both: Mask) -> tuple[Float, float, float]:
    """Ratio (rows, cols) on these nodes, else 0; its mean, and the mean distance from that over it."""
    out = np.empty(both.shape)
    total = away = 0.0
    count = 0
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            ratio = now[i, j] / kept[i, j]
            ratio = ratio if both[i, j] else 0.0
            out[i, j] = ratio
            total += ratio
            count += both[i, j]
    middle = total / count
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            away += abs(out[i, j] - middle) if both[i, j] else 0.0
    return out, middle, away / (middle * count)


@numba.njit(cache=True, error_model="numpy")
def _sums(values: Float, out: Float) -> None:
    """Sums of values (rows, cols) above and to the left; out: one row more, and a margin on either side."""
    rows, cols = values.shape
    margin = (out.shape[1] - 1 - cols) // 2
    out[0] = 0.0
    for i in range(rows):
        line, total = out[i + 1], 0.0
        line[: margin + 1] = 0.0
        for j in range(cols):
            total += values[i, j]
            line[margin + 1 + j] = total
        line[margin + 1 + cols :] = total
        above = out[i]
        for j in range(len(line)):
            line[j] += above[j]


@numba.njit(cache=True, error_model="numpy")
def _shares(counts: Float, boxes: NDArray[np.intp], out: Float) -> None:
    """1 over the number of known nodes in each box, over the number of boxes; counts: their `_sums`."""
    for one in range(len(boxes)):
        half = boxes[one] // 2
        near = boxes[-1] // 2 - half
        for i in range(out.shape[1]):
            top, bottom = max(i - half, 0), min(i + half + 1, out.shape[1])
            for j in range(out.shape[2]):
                left, right = near + j, near + boxes[one] + j
                count = counts[bottom, right] - counts[top, right] - counts[bottom, left] + counts[top, left]
                out[one, i, j] = 1.0 / (count * len(boxes)) if count > 0.5 else 0.0


@numba.njit(cache=True, error_model="numpy")
def _add_box_means(values: Float, shares: Float, boxes: NDArray[np.intp], other: float, out: Float) -> None:
    """Add the mean of the means over boxes around each node; `other` where a box has no known node.

    values: `_sums` of known values. shares: as of `Known`.
    """
    rows, cols = out.shape
    empty = other / len(boxes)
    for one in range(len(boxes)):
        half = boxes[one] // 2
        near = boxes[-1] // 2 - half
        left, right = slice(near, near + cols), slice(near + boxes[one], near + boxes[one] + cols)
        for i in range(rows):
            top, bottom = max(i - half, 0), min(i + half + 1, rows)
            a, b, c, d = values[bottom, right], values[top, right], values[bottom, left], values[top, left]
            share, to = shares[one, i], out[i]
            for j in range(cols):
                mean = (a[j] - b[j] - c[j] + d[j]) * share[j]
                to[j] += mean if share[j] > 0.0 else empty
