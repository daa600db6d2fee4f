"""From the measurable nodes to every pixel between them, and back to the nodes by the sensing window.

Both are products with a matrix along each axis: Keys' cubic convolution between nodes, as the picture is
drawn, with its missing neighbours beyond the border on the parabola through the last three; and the triangle
window over which a node's residual is averaged.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.sensing.window import triangle
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.interpolant import keys_weights


def _interpolation(pixels: int, spacing: int, nodes: int) -> Float:
    """(pixels, nodes): values at pixels 0, 1, ... from those of nodes 0, spacing, ..."""
    out = np.zeros((pixels, nodes + 2))
    for k in range(pixels):
        first = min(k // spacing, nodes - 2)
        out[k, first : first + 4] = keys_weights(k / spacing - first)
    for ghost, near in ((0, (1, 2, 3)), (-1, (-2, -3, -4))):
        for index, factor in zip(near, (3.0, -3.0, 1.0), strict=True):
            out[:, index] += factor * out[:, ghost]
    return out[:, 1:-1]


def _windows(pixels: int, period: int, spacing: int, nodes: int) -> Float:
    """(nodes, pixels) triangle windows of +-(period - 1) px around nodes at pixels 0, spacing, ...

    Parts of a window beyond the pixels are left out.
    """
    weights, out = triangle(period), np.zeros((nodes, pixels))
    for node in range(nodes):
        for weight, at in zip(weights, node * spacing + np.arange(1 - period, period), strict=True):
            if 0 <= at < pixels:
                out[node, at] = weight
    return out


def pixel_box(grid: NodeGrid) -> tuple[slice, slice]:
    """Rows and columns of the camera image between a grid's measurable nodes."""
    v, u = (axis[PADDING:-PADDING] for axis in (grid.v_px, grid.u_px))
    return slice(int(v[0]), int(v[-1]) + 1), slice(int(u[0]), int(u[-1]) + 1)


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
        spacing, period = grid.spacing_px, grid.period_px
        counts = tuple(zip(self.shape, self.nodes, strict=True))
        self._down, self._across = (_interpolation(n, spacing, m) for n, m in counts)
        self._single = self._down.astype(np.float32), self._across.T.astype(np.float32)
        self._windows = tuple(_windows(n, period, spacing, m).astype(np.float32) for n, m in counts)

    def to_pixels(self, nodes: Float) -> Single:
        """(..., rows, cols) of pixels from finite values (..., node rows, node cols), in single precision."""
        down, across = self._single
        return np.asarray(np.matmul(down, np.matmul(nodes.astype(np.float32), across)))

    def to_pixels_exact(self, nodes: Float) -> Float:
        """As `to_pixels`, in double precision."""
        return np.asarray(np.matmul(self._down, np.matmul(nodes, self._across.T)))

    def window_means(self, values: Single, used: Mask) -> tuple[Float, Float]:
        """Means (node rows, node cols, k) over the sensing window of used pixels, and their share of it.

        values: (rows, cols, k); used: (rows, cols). NaN where the share is 0.
        """
        down, across = self._windows
        share = down @ used.astype(np.float32) @ across.T
        masked = np.where(used[..., None], values, np.float32(0.0))
        sums = np.stack([down @ masked[..., k] @ across.T for k in range(values.shape[-1])], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return (sums / share[..., None]).astype(np.float64), share.astype(np.float64)

    def enclosed(self, nodes: Mask) -> Mask:
        """(rows, cols) of pixels whose four nodes around are all true."""
        spacing = self.grid.spacing_px
        rows, cols = self.shape
        down = np.minimum(np.arange(rows) // spacing, self.nodes[0] - 2)
        across = np.minimum(np.arange(cols) // spacing, self.nodes[1] - 2)
        cells = nodes[:-1, :-1] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[1:, 1:]
        return np.asarray(cells[np.ix_(down, across)])
