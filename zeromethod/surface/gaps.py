"""Gaps: steps of depth over nodes that were not measured, from the slopes on both sides.

Exact for a cubic: the trapezoidal rule with the end correction of Euler and Maclaurin, the curvatures taken
from the nodes next to the gap. As the slope inside is unknown, a quarter of the correction and a seventh of
the difference of the two slopes count as sigma. At the rim of a dry ball's contact the true error is a third
of that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask

WIDEST = 4
"""Nodes without a reading that a step may span."""
_DIFFERENCE, _CORRECTION = 0.15, 0.25
_LEAST_MM = 1e-8

Nodes = tuple[NDArray[np.intp], NDArray[np.intp]]


@dataclass(frozen=True, slots=True)
class Gaps:
    """Pairs of measured nodes with 1 to `WIDEST` others between them along a row or a column.

    ends: (n, 2, 2), (row, col) of the near and of the far node.
    """

    ends: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def near(self) -> Nodes:
        """Rows and columns of the near nodes."""
        return self.ends[:, 0, 0], self.ends[:, 0, 1]

    @property
    def far(self) -> Nodes:
        """Rows and columns of the far nodes."""
        return self.ends[:, 1, 0], self.ends[:, 1, 1]

    def steps(self, slope: Float, point: Float) -> tuple[Float, Float]:
        """Depth of the far minus the near nodes (n,), mm, and its standard deviation.

        slope: (rows, cols, 2) rad; point: (rows, cols, 2 or more) mm. NaN next to a gap counts as
        constant slope.
        """
        way = (point[self.far] - point[self.near])[:, :2]
        apart = self.ends[:, 1] - self.ends[:, 0]
        first, last = (slope[self.near] * way).sum(axis=-1), (slope[self.far] * way).sum(axis=-1)
        bend = self._bend(0, -np.sign(apart), slope, way) + self._bend(1, np.sign(apart), slope, way)
        correction = -np.abs(apart).sum(axis=-1) / 12.0 * bend
        spread = np.hypot(_CORRECTION * correction, _DIFFERENCE * (last - first))
        return 0.5 * (first + last) + correction, np.hypot(spread, _LEAST_MM)

    def _bend(self, end: int, away: NDArray[np.intp], slope: Float, way: Float) -> Float:
        """Change (n,) of slope along `way` from an end to its neighbour away from the gap."""
        node = self.ends[:, end]
        neighbour = node + away
        last = np.array(slope.shape[:2]) - 1
        neighbour = np.where((neighbour < 0) | (neighbour > last), node, neighbour)
        change = slope[neighbour[:, 0], neighbour[:, 1]] - slope[node[:, 0], node[:, 1]]
        bend: Float = np.nan_to_num((change * way).sum(axis=-1))
        return bend


def gaps_between(near: Mask, far: Mask) -> Gaps:
    """All gaps between nodes of two masks (rows, cols), without nodes of either inside; may be one mask."""
    ends = [_ends(near.T, far.T)[..., ::-1], _ends(near, far)]
    return Gaps(np.concatenate(ends))


def _ends(near: Mask, far: Mask) -> NDArray[np.intp]:
    """Ends (n, 2, 2) of the gaps along rows: (row, col) of the near and of the far node."""
    known = np.stack(np.nonzero(near | far), axis=-1)
    one, other = known[:-1], known[1:]
    apart = other[:, 1] - one[:, 1]
    gaps = (one[:, 0] == other[:, 0]) & (apart > 1) & (apart < WIDEST + 2)
    one, other = one[gaps], other[gaps]
    # each gap may be one from its first end to its last, and one back
    both = np.stack([np.stack([one, other], axis=1), np.stack([other, one], axis=1)], axis=1)
    starts, ends = both[:, :, 0], both[:, :, 1]
    found: NDArray[np.intp] = both[near[starts[..., 0], starts[..., 1]] & far[ends[..., 0], ends[..., 1]]]
    return found
