"""How noise of depth grows with that of the slopes around, octave by octave of their distance."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.kernels import kernel, read
from zeromethod.surface.node_passes import dot

_BOXES = (1, 3, 7, 15, 31, 63)
_EVEN = 0.02


def grown_by(power: Float, kept: Float, both: Mask, known: Known, anchor: Float) -> Float | float:
    """How the variance of depth has grown with slopes' noise, (rows, cols) or the same everywhere.

    power, kept: of the noise now and before, (rows, cols), both known on these nodes, whose `Known` is
    given. anchor: weights.
    """
    count = np.count_nonzero(both)
    if not count:
        return np.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(both, power / kept, 0.0)
    middle = float(ratio.sum()) / count
    if dot(np.abs(ratio - middle), both) < _EVEN * middle * count:
        return middle
    total = np.empty(both.shape)
    _box_means(_sums(ratio, known.boxes[-1]), known.shares, known.boxes, middle, total)
    at_anchor = float(dot(anchor, total) / max(float(anchor.sum()), 1e-30))
    return np.asarray(0.5 * (total + at_anchor))


class Known(NamedTuple):
    """Boxes around each node of a mask, and 1 over the number of its nodes in each, over that of the boxes.

    shares: (boxes, rows, cols); 0 where a box has none.
    """

    boxes: Ints
    shares: Float

    @classmethod
    def of(cls, nodes: Mask) -> Known:
        """For nodes (rows, cols)."""
        boxes = np.array([n for n in _BOXES if n <= max(nodes.shape)])
        sums = _sums(nodes.astype(np.float64), boxes[-1])
        counts = np.stack([_in_boxes(sums, boxes[-1] // 2, box // 2) for box in boxes])
        shares = np.divide(1.0 / len(boxes), counts, out=np.zeros(counts.shape), where=counts > 0.5)
        return cls(boxes, shares)


def _sums(values: Float, widest: int) -> Float:
    """Sums (rows + 1, ...) of values (rows, cols) above and to the left, half a box wider on both sides."""
    margin = int(widest // 2)
    wide = cv2.copyMakeBorder(values, 0, 0, margin, margin, cv2.BORDER_CONSTANT)
    return np.asarray(cv2.integral(wide, sdepth=cv2.CV_64F))


def _in_boxes(sums: Float, margin: int, half: int) -> Float:
    """Sums (rows, cols) over the box around each node; sums: `_sums`, with a margin on both sides."""
    row = np.arange(len(sums) - 1)
    cols, near = sums.shape[1] - 1 - 2 * margin, margin - half
    between = sums[np.minimum(row + half + 1, len(row))] - sums[np.maximum(row - half, 0)]
    return between[:, near + 2 * half + 1 :][:, :cols] - between[:, near : near + cols]


@kernel(
    read(numba.float64, 2), read(numba.float64, 3), read(numba.int64, 1), numba.float64, numba.float64[:, ::1]
)
def _box_means(sums: Float, shares: Float, boxes: Ints, other: float, out: Float) -> None:
    """Mean of the means over boxes around each node; `other` where a box has no known node.

    sums: `_sums` of known values. shares: as of `Known`.
    """
    rows, cols = out.shape
    empty = other / len(boxes)
    for i in range(rows):
        to = out[i]
        for j in range(cols):
            to[j] = 0.0
        for one in range(len(boxes)):
            half = boxes[one] // 2
            near, far = boxes[-1] // 2 - half, boxes[-1] // 2 + half + 1
            above, below, share = sums[max(i - half, 0)], sums[min(i + half + 1, rows)], shares[one, i]
            for j in range(cols):
                mean = (below[far + j] - above[far + j] - below[near + j] + above[near + j]) * share[j]
                to[j] += mean if share[j] > 0.0 else empty
