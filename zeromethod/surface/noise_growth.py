"""How noise of depth grows with that of the slopes around, octave by octave of their distance."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.surface.node_passes import dot

_BOXES = (1, 3, 7, 15, 31, 63)
_EVEN = 0.02


def grown_by(power: Float, kept: Float, both: Mask, known: Float, anchor: Float) -> Float | float:
    """How the variance of depth has grown with slopes' noise, (rows, cols) or the same everywhere.

    power, kept: of the noise now and before, (rows, cols), both known on these nodes, whose `known_sums`
    are given. anchor: weights.
    """
    ratio, middle, uneven = _ratios(power, kept, both)
    if uneven < _EVEN:
        return middle
    boxes = _boxes(ratio.shape)
    values, total = np.empty(known.shape), np.zeros(ratio.shape)
    _sums(ratio, values)
    _add_box_means(values, known, boxes, middle, total)
    at_anchor = float(dot(anchor, total) / max(float(anchor.sum()), 1e-30))
    return 0.5 * (total + at_anchor)


def _boxes(shape: tuple[int, ...]) -> NDArray[np.intp]:
    return np.array([n for n in _BOXES if n <= max(shape)])


def known_sums(nodes: Mask) -> Float:
    """`_sums` of the number of nodes (rows, cols), with a margin of half the last box."""
    rows, cols = nodes.shape
    out = np.empty((rows + 1, cols + 1 + 2 * int(_boxes(nodes.shape)[-1] // 2)))
    _sums(nodes.astype(np.float64), out)
    return out


@numba.njit(cache=True, error_model="numpy")
def _ratios(now: Float, kept: Float, both: Mask) -> tuple[Float, float, float]:
    """Ratio (rows, cols) on these nodes, else 0; its mean, and the mean distance from that over it."""
    out = np.zeros(both.shape)
    total = away = 0.0
    count = 0
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            if both[i, j]:
                out[i, j] = now[i, j] / kept[i, j]
                total += out[i, j]
                count += 1
    middle = total / count
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            if both[i, j]:
                away += abs(out[i, j] - middle)
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
def _add_box_means(values: Float, known: Float, boxes: NDArray[np.intp], other: float, out: Float) -> None:
    """Add the mean of the means over boxes around each node; `other` where a box has no known node.

    values, known: `_sums` of known values, and of their number, with a margin of half the last box.
    """
    rows, cols = out.shape
    for size in boxes:
        half = size // 2
        near = boxes[-1] // 2 - half
        left, right = slice(near, near + cols), slice(near + size, near + size + cols)
        for i in range(rows):
            top, bottom = max(i - half, 0), min(i + half + 1, rows)
            a, b, c, d = values[bottom, right], values[top, right], values[bottom, left], values[top, left]
            e, f, g, h = known[bottom, right], known[top, right], known[bottom, left], known[top, left]
            to = out[i]
            for j in range(cols):
                count = e[j] - f[j] - g[j] + h[j]
                mean = (a[j] - b[j] - c[j] + d[j]) / count if count > 0.5 else other
                to[j] += mean / len(boxes)
