"""What was read as means over blocks of nodes, at the points of the mirror at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
        self._nodes_per_mm = np.linalg.inv(np.stack(along, axis=-2))

    def read(self, read: PassResult) -> BlockReadings:
        """Means of a pass. Exact to first order in the shifts."""
        there = read.island[..., None]
        place = read.point[..., :2] - self._at
        away, slope = np.where(there, place, 0.0), np.where(there, read.slope, 0.0)
        nodes = np.einsum("...ij,...j->...i", self._nodes_per_mm, away)
        change = np.stack([_change(slope, read.island, axis) for axis in (0, 1)], axis=-1)
        at_rest = slope - np.einsum("...ki,...i->...k", change, nodes)
        ratio = (read.depth - (slope * away).sum(axis=-1)) / self._scale
        found = self.means(at_rest, ratio, read.island)
        # a plane through the variances of a block with gaps may go below 0
        count = np.maximum(self._blocks.sums(read.island.astype(np.float64)), 1.0)
        variance = self._blocks.sums(np.where(there, read.variance, 0.0)) / count[:, None]
        return replace(found, variance=variance)

    def means(self, slope: Float, ratio: Float, island: Mask) -> BlockReadings:
        """Means of slopes (rows, cols, 2) and depth / h (rows, cols), without noise."""
        both = np.concatenate([slope, ratio[..., None]], axis=-1)
        means, used = self._blocks.means(both, island)
        return BlockReadings(means[:, :2], means[:, 2], np.zeros((len(means), 2)), used)


def _change(values: Float, there: Mask, axis: int) -> Float:
    """Change of values (rows, cols, n) per node along an axis, by neighbours that are there."""
    step = np.diff(values, axis=axis)
    known = np.diff(there.astype(np.int8), axis=axis) == 0
    known &= there[1:] if axis == 0 else there[:, 1:]
    total, count = np.zeros(values.shape), np.zeros(there.shape)
    for side in (slice(None, -1), slice(1, None)):
        nodes = (side,) if axis == 0 else (slice(None), side)
        total[nodes] += np.where(known[..., None], step, 0.0)
        count[nodes] += known
    return total / np.maximum(count, 1.0)[..., None]
