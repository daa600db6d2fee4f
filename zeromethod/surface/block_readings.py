"""What was read as means over blocks of nodes, at the points of the mirror at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.pass_result import PassResult
from zeromethod.warp.blocks import Blocks


@dataclass(frozen=True, slots=True)
class BlockReadings:
    """Means over blocks: slopes y (n, 2) and depth / h (n,), mm, at the points of rest.

    variance: (n, 2) of one node's slopes. used: (n,) blocks.
    """

    slope: Float
    ratio: Float
    variance: Float
    used: Mask


class BlockReader:
    """Makes block readings of one lattice. A node 0.2 mm deep lies about as far from where it was at rest."""

    def __init__(self, blocks: Blocks, x_mm: Float, y_mm: Float, scale: Float) -> None:
        """x_mm, y_mm, scale h: (rows, cols) at rest."""
        self._blocks, self._at, self._scale = blocks, np.stack([x_mm, y_mm], axis=-1), scale
        along = [np.stack([np.gradient(one, axis=k) for k in (0, 1)], axis=-1) for one in (x_mm, y_mm)]
        nodes_per_mm = np.linalg.inv(np.stack(along, axis=-2))
        self._nodes_per_mm = np.ascontiguousarray(np.moveaxis(nodes_per_mm, (-2, -1), (0, 1)))

    def read(self, read: PassResult) -> BlockReadings:
        """Means of a pass. Exact to first order in the shifts."""
        there = read.island
        # planes of one component each: numpy is several times as fast with these as with pairs
        away = [np.where(there, read.point[..., k] - self._at[..., k], 0.0) for k in (0, 1)]
        slope = [np.where(there, read.slope[..., k], 0.0) for k in (0, 1)]
        nodes = [of[0] * away[0] + of[1] * away[1] for of in self._nodes_per_mm]
        sides = [_sides(there, axis) for axis in (0, 1)]
        at_rest = [
            one - sum(_change(one, *sides[axis], axis) * nodes[axis] for axis in (0, 1)) for one in slope
        ]
        ratio = (read.depth - slope[0] * away[0] - slope[1] * away[1]) / self._scale
        found = self.means(np.stack(at_rest, axis=-1), ratio, there)
        # a plane through the variances of a block with gaps may go below 0
        count = np.maximum(self._blocks.sums(there.astype(np.float64)), 1.0)
        variance = self._blocks.sums(np.where(there[..., None], read.variance, 0.0)) / count[:, None]
        return replace(found, variance=variance)

    def means(self, slope: Float, ratio: Float, island: Mask) -> BlockReadings:
        """Means of slopes (rows, cols, 2) and depth / h (rows, cols), without noise."""
        both = np.concatenate([slope, ratio[..., None]], axis=-1)
        means, used = self._blocks.means(both, island)
        return BlockReadings(means[:, :2], means[:, 2], np.zeros((len(means), 2)), used)


def _sides(there: Mask, axis: int) -> tuple[Mask, Float]:
    """Between which neighbours along an axis both are there, and one over how many of a node's are."""
    known = np.logical_and(*_neighbours(there, axis))
    count = np.zeros(there.shape)
    for side in _neighbours(count, axis):
        np.add(side, known, out=side)
    return known, 1.0 / np.maximum(count, 1.0)


def _change(values: Float, known: Mask, share: Float, axis: int) -> Float:
    """Change of values (rows, cols) per node along an axis, by neighbours that are there."""
    before, after = _neighbours(values, axis)
    step = (after - before) * known
    total = np.zeros(values.shape)
    for side in _neighbours(total, axis):
        np.add(side, step, out=side)
    return np.asarray(total * share)


def _neighbours(values: Any, axis: int) -> tuple[Any, Any]:
    """Views of the nodes before and of those after each step along an axis."""
    return (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
