"""From the measurable nodes to every pixel between them, and back to the nodes by the sensing window.

Both go along each axis in turn: Keys' cubic convolution between nodes, as the picture is drawn, with its
missing neighbours beyond the border on the parabola through the last three; and the triangle window over
which a node's residual is averaged.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Ints, Mask, Single
from zeromethod.rounding import REORDERED
from zeromethod.sensing.window import triangle
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.interpolant import keys
from zeromethod.warp.validity import Flag


class Between(NamedTuple):
    """Keys' weights between nodes.

    of_rows: (rows, 4) of pixel row k, of the rows of nodes from first[k] on, a ghost ahead. of_cell: (4,
    spacing) of the pixels from a node to the next along a row, of the nodes from one before it on.
    """

    first: Ints
    of_rows: Float
    of_cell: Float

    @classmethod
    def of(cls, rows: int, spacing: int, nodes: int) -> Between:
        """For pixel rows 0, 1, ... and nodes at 0, spacing, ..."""
        at = np.arange(rows)
        first = np.minimum(at // spacing, nodes - 2)
        of_rows = np.stack(keys(at / spacing - first), axis=-1)
        return cls(first, of_rows, np.stack(keys(np.arange(spacing) / spacing)))


def with_ghosts(nodes: Float) -> Float:
    """Planes (k, rows + 2, cols + 2) with a neighbour more on every side, on the last three's parabola."""
    out = np.pad(nodes, ((0, 0), (1, 1), (1, 1)))
    out[:, 0] = 3.0 * (out[:, 1] - out[:, 2]) + out[:, 3]
    out[:, -1] = 3.0 * (out[:, -2] - out[:, -3]) + out[:, -4]
    out[..., 0] = 3.0 * (out[..., 1] - out[..., 2]) + out[..., 3]
    out[..., -1] = 3.0 * (out[..., -2] - out[..., -3]) + out[..., -4]
    return out


@numba.njit(cache=True, inline="always")
def pixel_line(nodes: Any, first: Any, weights: Any, of_cell: Any, line: Any, out: Any) -> None:
    """A row of pixels from the four rows of nodes, with ghosts, from `first` on; line: of a row of nodes.

    Cell by cell, so that the pixels of each are computed at once.
    """
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    for i in range(len(line)):
        line[i] = w0 * nodes[first, i] + w1 * nodes[first + 1, i]
        line[i] += w2 * nodes[first + 2, i] + w3 * nodes[first + 3, i]
    spacing, cells = of_cell.shape[1], len(line) - 3
    for i in range(cells):
        a, b, c, d = line[i], line[i + 1], line[i + 2], line[i + 3]
        for k in range(spacing):
            out[i * spacing + k] = (
                of_cell[0, k] * a + of_cell[1, k] * b + of_cell[2, k] * c + of_cell[3, k] * d
            )
    out[cells * spacing] = line[cells + 1]


@numba.njit(cache=True)
def _to_pixels(nodes: Any, row_first: Any, of_rows: Any, of_cell: Any, out: Any) -> None:
    """Planes with ghosts (k, rows, cols) at the pixels (k, rows, cols)."""
    line = np.empty(nodes.shape[2])
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            pixel_line(nodes[k], row_first[j], of_rows[j], of_cell, line, out[k, j])


@numba.njit(cache=True, fastmath=REORDERED)
def _window_sums(values: Any, used: Any, triangle: Any, spacing: int, out: Any) -> None:
    """Sums (node rows, node cols, k + 1) over windows of used pixels' values (rows, cols, k), and of 1.

    The border's pixels count half, so that what alternates from one to the next, as the LCD's grid does,
    leaves nothing in a window that ends there.
    """
    rows, cols, count = values.shape
    reach = len(triangle) // 2
    line = np.empty((cols, count + 1), np.float32)
    for j in range(out.shape[0]):
        line[:] = np.float32(0.0)
        for row in range(max(j * spacing - reach, 0), min(j * spacing + reach + 1, rows)):
            weight = triangle[row - j * spacing + reach]
            if row == 0 or row == rows - 1:
                weight *= np.float32(0.5)
            for col in range(cols):
                if used[row, col]:
                    for k in range(count):
                        line[col, k] += weight * values[row, col, k]
                    line[col, count] += weight
        for i in range(out.shape[1]):
            out[j, i] = 0.0
            for col in range(max(i * spacing - reach, 0), min(i * spacing + reach + 1, cols)):
                weight = triangle[col - i * spacing + reach]
                if col == 0 or col == cols - 1:
                    weight *= np.float32(0.5)
                for k in range(count + 1):
                    out[j, i, k] += weight * line[col, k]


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
        self.between = Between.of(self.shape[0], grid.spacing_px, self.nodes[0])
        """Weights of nodes at pixels."""
        self._triangle = triangle(grid.period_px).astype(np.float32)

    def to_pixels(self, nodes: Float) -> Single:
        """(..., rows, cols) of pixels from finite values (..., node rows, node cols), in single precision."""
        return np.asarray(self._between(nodes, np.float32))

    def to_pixels_exact(self, nodes: Float) -> Float:
        """As `to_pixels`, in double precision."""
        return np.asarray(self._between(nodes, np.float64))

    def _between(self, nodes: Float, kind: type) -> Any:
        planes = with_ghosts(np.asarray(nodes, np.float64).reshape(-1, *self.nodes))
        out = np.empty((len(planes), *self.shape), kind)
        _to_pixels(planes, *self.between, out)
        return out.reshape(nodes.shape[:-2] + self.shape)

    def window_means(self, values: Single, used: Mask) -> tuple[Float, Float]:
        """Means (node rows, node cols, k) over the sensing window of used pixels, and their share of it.

        values: (rows, cols, k); used: (rows, cols). NaN where the share is 0.
        """
        sums = np.empty((*self.nodes, values.shape[-1] + 1))
        _window_sums(values, used, self._triangle, self.grid.spacing_px, sums)
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
