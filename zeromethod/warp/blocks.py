"""Blocks of nodes: means of what was read, and the places at which a smooth field has that mean.

Noise of neighbouring nodes is correlated and loads are smooth, so some 300 blocks say nearly all that 20,000
nodes say of what presses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod.arrays import Float, Ints, Mask

_SHORTER = 15
"""Blocks along the lattice's shorter side: what presses is told apart by fields of the view's size."""
_MOST = 450
"""Blocks in all, of a lattice longer than twice its width: learning takes the cube of their number."""
_LEAST_SHARE = 0.5
"""Share of a block's nodes below which it is left out: its mean would be that of a plane through few."""
_FLAT = 1e-9
"""Determinant of the nodes' second moments, nodes^4, below which they lie on one line."""


@dataclass(frozen=True)
class Blocks:
    """Even blocks of a lattice; first_row, first_col: of each row and column of blocks."""

    shape: tuple[int, int]
    first_row: Ints
    first_col: Ints

    @classmethod
    def of(cls, shape: tuple[int, int]) -> Blocks:
        """Nearly square ones."""
        size = max(min(shape) / _SHORTER, np.sqrt(shape[0] * shape[1] / _MOST), 1.0)
        rows, cols = (np.linspace(0, n, max(round(n / size), 1) + 1).round().astype(int)[:-1] for n in shape)
        return cls(shape, rows, cols)

    @property
    def count(self) -> int:
        """Of blocks."""
        return len(self.first_row) * len(self.first_col)

    def sums(self, values: Float) -> Float:
        """(blocks, ...) of values (rows, cols, ...)."""
        rows = np.add.reduceat(values, self.first_row, axis=0)
        return np.add.reduceat(rows, self.first_col, axis=1).reshape(self.count, *values.shape[2:])

    def spread(self, of_blocks: Float) -> Float:
        """(rows, cols) each node its block's value, of (blocks,)."""
        down, across = self._sizes
        whole = of_blocks.reshape(len(down), len(across))
        return np.repeat(np.repeat(whole, down, axis=0), across, axis=1)

    def border(self, share: float) -> Mask:
        """(blocks,) those within a share of the shorter side from the lattice's border."""
        rows, cols = len(self.first_row), len(self.first_col)
        width = max(round(share * min(rows, cols)), 1)
        out = np.ones((rows, cols), bool)
        out[width:-width, width:-width] = False
        return out.ravel()

    @property
    def _sizes(self) -> tuple[Ints, Ints]:
        """Rows and columns of nodes of each row and column of blocks."""
        rows, cols = self.shape
        return np.diff(np.append(self.first_row, rows)), np.diff(np.append(self.first_col, cols))

    @cached_property
    def _moments(self) -> tuple[Float, Float]:
        """(rows, cols, 2): places of nodes about their block's middle; (blocks, 2) sizes; in nodes."""
        offsets, sizes = [], []
        for first, n, size in zip((self.first_row, self.first_col), self.shape, self._sizes, strict=True):
            offsets.append(np.arange(n) - np.repeat(first + 0.5 * (size - 1), size))
            sizes.append(size.astype(np.float64))
        places = np.stack(np.meshgrid(*offsets, indexing="ij"), axis=-1)
        return places, np.stack([s.ravel() for s in np.meshgrid(*sizes, indexing="ij")], axis=-1)

    def means(self, values: Float, nodes: Mask) -> tuple[Float, Mask]:
        """Means (blocks, n) of values (rows, cols, n) that some nodes have; which blocks have enough of them.

        Of a block with gaps it is that of the plane that fits its nodes best; those on one line fit many.
        """
        place, size = self._moments
        count = self.sums(nodes.astype(np.float64))
        enough = count >= _LEAST_SHARE * size.prod(axis=1)
        there = np.where(nodes[..., None], values, 0.0)
        of_values = self.sums(there)
        least = np.maximum(count, 1.0)[:, None]
        mean = of_values / least
        gaps = enough & (count < size.prod(axis=1))
        if gaps.any():
            first = self.sums(place * nodes[..., None]) / least
            square = np.stack(
                [place[..., 0] ** 2, place[..., 1] ** 2, place[..., 0] * place[..., 1]], axis=-1
            )
            xx, yy, xy = np.moveaxis(self.sums(square * nodes[..., None]) / least, -1, 0)
            mixed = np.stack([self.sums(there * place[..., k, None]) / least for k in (0, 1)])
            xx, yy, xy = xx - first[:, 0] ** 2, yy - first[:, 1] ** 2, xy - first[:, 0] * first[:, 1]
            mixed -= first.T[:, :, None] * mean
            det = xx * yy - xy**2
            enough &= ~gaps | (det > _FLAT)
            det = np.maximum(det, _FLAT)[:, None]
            tilt = np.stack(
                [
                    yy[:, None] * mixed[0] - xy[:, None] * mixed[1],
                    xx[:, None] * mixed[1] - xy[:, None] * mixed[0],
                ]
            )
            mean = np.where(gaps[:, None], mean - (tilt / det * first.T[:, :, None]).sum(axis=0), mean)
        return mean, enough

    def places(self, values: Float) -> tuple[Float, Float]:
        """Values (blocks, 9) of a smooth field (rows, cols) at nine places of each block, and their weights.

        A field of degree 5 has the same mean over these as over all of a block's nodes.
        """
        _, size = self._moments
        first = self.first_row, self.first_col
        middle = [one + 0.5 * (n - 1) for one, n in zip(first, self._sizes, strict=True)]
        row, col = (m.ravel() for m in np.meshgrid(*middle, indexing="ij"))
        way = np.sqrt(np.maximum(3 * size**2 - 7, 1.0) / 20)
        outer = 0.5 * (size**2 - 1) / 12 / way**2
        signs = np.array([-1.0, 0.0, 1.0])
        weights = np.stack([outer, 1 - 2 * outer, outer], axis=-1)
        at_row = (row[:, None, None] + way[:, 0, None, None] * signs[:, None] + 0 * signs).reshape(
            len(row), 9
        )
        at_col = (col[:, None, None] + way[:, 1, None, None] * signs + 0 * signs[:, None]).reshape(
            len(row), 9
        )
        both = (weights[:, 0, :, None] * weights[:, 1, None, :]).reshape(len(row), 9)
        return map_coordinates(values, [at_row, at_col], order=1, mode="nearest"), both

    def correlation(self, nodes: Float) -> tuple[Float, Float]:
        """Covariance between means of whole blocks down (n, n) and across (m, m), of noise of variance 1.

        nodes: its correlation between nodes 0, 1, 2, ... apart along either axis.
        """
        out = []
        for first, n, size in zip((self.first_row, self.first_col), self.shape, self._sizes, strict=True):
            apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
            whole = np.where(apart < len(nodes), nodes[np.minimum(apart, len(nodes) - 1)], 0.0)
            whole = np.add.reduceat(np.add.reduceat(whole, first, axis=0), first, axis=1)
            out.append(whole / np.outer(size, size))
        return out[0], out[1]
