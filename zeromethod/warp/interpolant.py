"""The interpolant between nodes, shared by composing, drawing and reading.

Keys' cubic convolution with a = -1/2 (doi:10.1109/TASSP.1981.1163711), tensor product over the
node lattice: C1, reproduces polynomials up to degree 2, error O(h^3), support 4 x 4 nodes. Drawing
and composing must use the same function between nodes, or a constant error remains that no iteration
removes.

In the mean over a sensing window the interpolant of a wave of k rad per node is lower than the wave, by the
share k^4 / 80. A null compares such means, so that node values would come out too large by as much (0.04 %
for a dent of sigma 3.7 nodes); `window_matched` is drawn in place of the node values.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float, Single
from zeromethod.kernels import kernel, piece, read


def keys(t: Any) -> tuple[Any, Any, Any, Any]:
    """Weights of nodes i-1, i, i+1, i+2 at i + t, 0 <= t <= 1; exactly (0, 1, 0, 0) at t = 0.

    t: a number or an array.
    """
    s = 1.0 - t
    return -0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t


keys_weights = piece(keys)
"""`keys` of a number, in compiled functions."""

MEAN_LOSS = 1 / 80
"""Loss of a wave in the interpolant's mean over a sensing window, over k^4, k in rad per node."""


_FOURTH = MEAN_LOSS * np.array([[1.0, -4.0, 6.0, -4.0, 1.0]])


def window_matched(q: Float, out: Single) -> None:
    """Node values whose interpolant has, in the mean over a window around each node, the value q there.

    q: (rows, cols, 2). out: (rows, cols, 2 or more), the first two are filled. Along an axis where 2 nodes on
    either side are missing or NaN the value stays. To sixth order; a cubic polynomial stays as it is.
    """
    along, across = cv2.filter2D(q, -1, _FOURTH), cv2.filter2D(q, -1, _FOURTH.T)
    along[:, :2] = along[:, -2:] = 0.0
    across[:2] = across[-2:] = 0.0
    total = q + along + across
    if not np.isfinite(total).all():
        total = q + np.where(np.isfinite(along), along, 0.0) + np.where(np.isfinite(across), across, 0.0)
    out[..., :2] = total


@piece(fastmath={"contract"}, inline="always")
def sample_pair(field: Float, col: float, row: float) -> tuple[float, float]:
    """Both components of `field` (rows, cols, 2) at a node position; NaN outside [1, n - 2] or at NaN."""
    rows, cols = field.shape[0], field.shape[1]
    if not (1.0 <= col <= cols - 2.0 and 1.0 <= row <= rows - 2.0):
        return math.nan, math.nan
    # unsigned, as each index that may be negative is checked for that
    i, j = np.uintp(min(int(col), cols - 3)), np.uintp(min(int(row), rows - 3))
    h0, h1, h2, h3 = keys_weights(col - float(i))
    v0, v1, v2, v3 = keys_weights(row - float(j))
    h, k, m = i - np.uintp(1), i + np.uintp(1), i + np.uintp(2)
    a, b, c, d = field[j - np.uintp(1)], field[j], field[j + np.uintp(1)], field[j + np.uintp(2)]
    x0 = h0 * a[h, 0] + h1 * a[i, 0] + h2 * a[k, 0] + h3 * a[m, 0]
    y0 = h0 * a[h, 1] + h1 * a[i, 1] + h2 * a[k, 1] + h3 * a[m, 1]
    x1 = h0 * b[h, 0] + h1 * b[i, 0] + h2 * b[k, 0] + h3 * b[m, 0]
    y1 = h0 * b[h, 1] + h1 * b[i, 1] + h2 * b[k, 1] + h3 * b[m, 1]
    x2 = h0 * c[h, 0] + h1 * c[i, 0] + h2 * c[k, 0] + h3 * c[m, 0]
    y2 = h0 * c[h, 1] + h1 * c[i, 1] + h2 * c[k, 1] + h3 * c[m, 1]
    x3 = h0 * d[h, 0] + h1 * d[i, 0] + h2 * d[k, 0] + h3 * d[m, 0]
    y3 = h0 * d[h, 1] + h1 * d[i, 1] + h2 * d[k, 1] + h3 * d[m, 1]
    return v0 * x0 + v1 * x1 + v2 * x2 + v3 * x3, v0 * y0 + v1 * y1 + v2 * y2 + v3 * y3


@kernel(read(numba.float64, 3), read(numba.float64, 1), read(numba.float64, 1), numba.float64[:, ::1])
def _sample(field: Float, col: Float, row: Float, out: Float) -> None:
    rows, cols, depth = field.shape
    for n in range(col.size):
        x, y = col[n], row[n]
        inside = 1.0 <= x <= cols - 2.0 and 1.0 <= y <= rows - 2.0
        i, j = (min(int(x), cols - 3), min(int(y), rows - 3)) if inside else (1, 1)
        h0, h1, h2, h3 = keys_weights(x - i)
        down = keys_weights(y - j)
        for k in range(depth):
            out[n, k] = 0.0 if inside else math.nan
        if inside:
            for r in range(4):
                line = field[j - 1 + r]
                a, b, c, d = line[i - 1], line[i], line[i + 1], line[i + 2]
                for k in range(depth):
                    out[n, k] += down[r] * (h0 * a[k] + h1 * b[k] + h2 * c[k] + h3 * d[k])


def sample(field: Float, col: ArrayLike, row: ArrayLike) -> Float:
    """Value of a node field between its nodes.

    field: (rows, cols, k). col, row: any shape, in nodes (node i at i; a camera column u lies at
    (u - grid.u_px[0]) / grid.spacing_px). Returns (..., k); NaN outside [1, n - 2] on either axis, where
    the 4 x 4 support does not fit, and where a node of the support is NaN.

    Convention: field is indexed (row, column), positions are given (column, row).
    """
    x, y = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    out = np.empty((x.size, field.shape[2]))
    _sample(field, x.ravel(), y.ravel(), out)
    return out.reshape(*x.shape, field.shape[2])
