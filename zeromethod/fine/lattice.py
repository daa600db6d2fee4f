"""From the measurable nodes to every pixel between them, and back to the nodes by the sensing window.

Both go along each axis in turn: Keys' cubic convolution between nodes, as the picture is drawn, with its
missing neighbours beyond the border on the parabola through the last three; and the triangle window over
which a node's residual is averaged.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from scipy.sparse import csr_array

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.sensing.window import triangle
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.interpolant import keys
from zeromethod.warp.validity import Flag

BAND_ROWS = 32
"""Rows of pixels that are worked out at a time: what they take stays in the processor's cache."""


def keys_weights(pixels: int, nodes: int, spacing: int) -> Float:
    """(pixels, nodes) Keys' weights of pixels 0, 1, ... between nodes at 0, spacing, ..."""
    at = np.arange(pixels)
    before = np.minimum(at // spacing, nodes - 2)
    weights = np.zeros((pixels, nodes + 2))  # a neighbour more at either end
    for k, weight in enumerate(keys(at / spacing - before)):
        weights[at, before + k] = weight
    for node, share in ((1, 3.0), (2, -3.0), (3, 1.0)):
        weights[:, node] += share * weights[:, 0]
        weights[:, -1 - node] += share * weights[:, -1]
    return weights[:, 1:-1]


def window_weights(pixels: int, nodes: int, spacing: int, period: int) -> csr_array:
    """(nodes, pixels) weights of pixels 0, 1, ... in the sensing windows around nodes at 0, spacing, ...

    The border's pixels count half, so that what alternates from one to the next, as the LCD's grid does,
    leaves nothing in a window that ends there.
    """
    reach = period - 1
    weights = np.zeros((nodes, pixels + 2 * reach))
    for node, line in enumerate(weights):
        line[node * spacing : node * spacing + 2 * reach + 1] = triangle(period)
    weights = weights[:, reach : reach + pixels]
    weights[:, [0, -1]] *= 0.5
    return csr_array(weights)


def pixel_box(grid: NodeGrid) -> tuple[slice, slice]:
    """Rows and columns of the camera image between a grid's measurable nodes."""
    v, u = (axis[PADDING:-PADDING] for axis in (grid.v_px, grid.u_px))
    return slice(int(v[0]), int(v[-1]) + 1), slice(int(u[0]), int(u[-1]) + 1)


def uncovered_box(grid: NodeGrid, flags: Flags) -> tuple[slice, slice] | None:
    """Rows and columns of the image between the nodes that no coded strip covers; None where none does."""
    free = flags[grid.inner] & Flag.OUTSIDE == 0
    if free.all() or not free.any():
        return None
    spans = []
    for axis, nodes in ((grid.v_px, free.any(axis=1)), (grid.u_px, free.any(axis=0))):
        among = axis[PADDING:-PADDING][nodes]
        spans.append(slice(int(among[0]), int(among[-1]) + 1))
    return spans[0], spans[1]


class PixelLattice:
    """The pixels between a grid's measurable nodes.

    box: their rows and columns in the camera image.
    """

    def __init__(self, grid: NodeGrid) -> None:
        self.grid = grid
        self.box = pixel_box(grid)
        rows, cols = grid.shape
        self.nodes = rows - 2 * PADDING, cols - 2 * PADDING
        self.shape = tuple(part.stop - part.start for part in self.box)
        sizes = tuple(zip(self.shape, self.nodes, strict=True))
        self._down, across = (keys_weights(*size, grid.spacing_px) for size in sizes)
        self._across = csr_array(across)
        self._window = [window_weights(*size, grid.spacing_px, grid.period_px) for size in sizes]

    def bands(self, nodes: Float, kind: Any = np.float64) -> Iterator[tuple[slice, Any]]:
        """Some rows of pixels after the other, and there (rows, k, cols) of finite planes of the nodes.

        nodes: (k, node rows, node cols). kind: float64, or float32 for a faster result.
        """
        count, rows, cols = len(nodes), *self.shape
        across = self._across @ nodes.transpose(2, 1, 0).reshape(self.nodes[1], -1)
        lines = np.asarray(cv2.transpose(across.astype(kind))).reshape(-1, count * cols)
        down = self._down.astype(kind)
        for first in range(0, rows, BAND_ROWS):
            part = slice(first, min(first + BAND_ROWS, rows))
            near = down[part].any(axis=0)
            yield part, (down[part][:, near] @ lines[near]).reshape(-1, count, cols)

    def to_pixels(self, nodes: Float) -> Single:
        """(..., rows, cols) of pixels from finite values (..., node rows, node cols), in single precision."""
        return np.asarray(self._between(nodes, np.float32))

    def to_pixels_exact(self, nodes: Float) -> Float:
        """As `to_pixels`, in double precision."""
        return np.asarray(self._between(nodes, np.float64))

    def _between(self, nodes: Float, kind: type) -> Any:
        planes = nodes.reshape(-1, *self.nodes)
        out = np.empty((len(planes), *self.shape), kind)
        for rows, values in self.bands(planes):
            out[:, rows] = np.moveaxis(values, 1, 0)
        return out.reshape(nodes.shape[:-2] + self.shape)

    def window_means(self, values: Single, used: Mask) -> tuple[Float, Float]:
        """Means (node rows, node cols, k) over the sensing window of used pixels, and their share of it.

        values: (rows, cols, k); used: (rows, cols). NaN where the share is 0.
        """
        (rows, cols, count), (down, across) = values.shape, self._window
        planes = np.empty((rows, count + 1, cols), np.float32)
        for k in range(count):
            planes[:, k] = np.where(used, values[..., k], np.float32(0.0))
        planes[:, count] = used
        lines = (down.astype(np.float32) @ planes.reshape(rows, -1)).astype(np.float64)
        sums = (across @ lines.reshape(-1, cols).T).reshape(*self.nodes[::-1], -1).transpose(1, 0, 2)
        share = sums[..., -1]
        with np.errstate(invalid="ignore", divide="ignore"):
            return sums[..., :-1] / share[..., None], share

    def enclosed(self, nodes: Mask) -> Mask:
        """(rows, cols) of pixels whose four nodes around are all true."""
        return self.of_cells(nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:])

    def of_cells(self, cells: Mask) -> Mask:
        """(rows, cols) of pixels in those cells (node rows - 1, node cols - 1) that are true."""
        down, across = (
            np.minimum(np.arange(pixels) // self.grid.spacing_px, nodes - 2)
            for pixels, nodes in zip(self.shape, self.nodes, strict=True)
        )
        return np.asarray(cells[np.ix_(down, across)])

    def cell_means(self, values: Single) -> Float:
        """Means (node rows - 1, node cols - 1, ...) over each cell of pixels' values (rows, cols, ...)."""
        (rows, cols), spacing = (n - 1 for n in self.nodes), self.grid.spacing_px
        of_cells = values[:-1, :-1].reshape(rows, spacing, cols, spacing, *values.shape[2:])
        return np.asarray(of_cells.mean(axis=(1, 3), dtype=np.float64))
