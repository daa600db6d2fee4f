"""What was read as means over blocks of nodes, at the points of the mirror at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.blocks import Blocks


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
        self._blocks, self._x, self._y, self._scale = blocks, x_mm, y_mm, scale
        along = [np.stack(np.gradient(one), axis=-1) for one in (x_mm, y_mm)]
        self._nodes_per_mm = np.linalg.inv(np.stack(along, axis=-2))

    def read(
        self, slope: Float, variance: Float, depth_mm: Float, x_mm: Float, y_mm: Float, island: Mask
    ) -> BlockReadings:
        """Of nodes (rows, cols) on an island; slope, variance: (rows, cols, 2). Exact to first order in the shifts."""
        there = island[..., None]
        away = np.where(there, np.stack([x_mm - self._x, y_mm - self._y], axis=-1), 0.0)
        slope = np.where(there, slope, 0.0)
        nodes = np.einsum("...ij,...j->...i", self._nodes_per_mm, away)
        change = np.stack(np.gradient(slope, axis=(0, 1)), axis=-1)
        at_rest = slope - np.einsum("...ki,...i->...k", change, nodes)
        ratio = (depth_mm - (slope * away).sum(axis=-1)) / self._scale
        values = np.concatenate([at_rest, ratio[..., None], np.where(there, variance, 0.0)], axis=-1)
        means, used = self._blocks.means(values, island)
        return BlockReadings(means[:, :2], means[:, 2], means[:, 3:], used)
