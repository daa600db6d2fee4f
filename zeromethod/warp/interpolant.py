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

import numba
import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float, Single


@numba.njit(cache=True, inline="always")
def keys_weights(t: float) -> tuple[float, float, float, float]:
    """Weights of nodes i-1, i, i+1, i+2 at i + t, 0 <= t <= 1; exactly (0, 1, 0, 0) at t = 0."""
    s = 1.0 - t
    return -0.5 * t * s * s, 1.0 + t * t * (1.5 * t - 2.5), 1.0 + s * s * (1.5 * s - 2.5), -0.5 * s * t * t


MEAN_LOSS = 1 / 80
"""Loss of a wave in the interpolant's mean over a sensing window, over k^4, k in rad per node."""


@numba.njit(cache=True)
def window_matched(q: Float, out: Single) -> None:
    """Node values whose interpolant has, in the mean over a window around each node, the value q there.

    q: (rows, cols, 2). out: (rows, cols, 2 or more), the first two are filled. Along an axis where 2 nodes on
    either side are missing or NaN the value stays. To sixth order; a cubic polynomial stays as it is.
    """
    rows, cols = q.shape[0], q.shape[1]
    for j in range(rows):
        for i in range(cols):
            for k in range(2):
                value = q[j, i, k]
                if 2 <= i < cols - 2:
                    fourth = q[j, i - 2, k] + q[j, i + 2, k] - 4 * (q[j, i - 1, k] + q[j, i + 1, k])
                    fourth += 6 * q[j, i, k]
                    value += MEAN_LOSS * fourth if math.isfinite(fourth) else 0.0
                if 2 <= j < rows - 2:
                    fourth = q[j - 2, i, k] + q[j + 2, i, k] - 4 * (q[j - 1, i, k] + q[j + 1, i, k])
                    fourth += 6 * q[j, i, k]
                    value += MEAN_LOSS * fourth if math.isfinite(fourth) else 0.0
                out[j, i, k] = value


@numba.njit(cache=True, fastmath={"contract"}, inline="always")
def _across(line: Float, i: np.uintp, w: tuple[float, float, float, float]) -> tuple[float, float]:
    """Both components of a row of nodes by the weights of nodes i - 1 to i + 2."""
    # unsigned, as each index that may be negative is checked for that
    h, k, m = i - np.uintp(1), i + np.uintp(1), i + np.uintp(2)
    x = w[0] * line[h, 0] + w[1] * line[i, 0] + w[2] * line[k, 0] + w[3] * line[m, 0]
    y = w[0] * line[h, 1] + w[1] * line[i, 1] + w[2] * line[k, 1] + w[3] * line[m, 1]
    return x, y


@numba.njit(cache=True, fastmath={"contract"}, inline="always")
def sample_pair(field: Float, col: float, row: float) -> tuple[float, float]:
    """Both components of `field` (rows, cols, 2) at a node position; NaN outside [1, n - 2] or at NaN."""
    rows, cols = field.shape[0], field.shape[1]
    if not (1.0 <= col <= cols - 2.0 and 1.0 <= row <= rows - 2.0):
        return math.nan, math.nan
    i = np.uintp(min(int(col), cols - 3))
    j = np.uintp(min(int(row), rows - 3))
    across = keys_weights(col - float(i))
    w0, w1, w2, w3 = keys_weights(row - float(j))
    x0, y0 = _across(field[j - np.uintp(1)], i, across)
    x1, y1 = _across(field[j], i, across)
    x2, y2 = _across(field[j + np.uintp(1)], i, across)
    x3, y3 = _across(field[j + np.uintp(2)], i, across)
    return w0 * x0 + w1 * x1 + w2 * x2 + w3 * x3, w0 * y0 + w1 * y1 + w2 * y2 + w3 * y3


@numba.njit(cache=True)
def _sample(field: Float, col: Float, row: Float, out: Float) -> None:
    rows, cols, depth = field.shape
    for n in range(col.size):
        x, y = col[n], row[n]
        if not (1.0 <= x <= cols - 2.0 and 1.0 <= y <= rows - 2.0):
            out[n] = math.nan
            continue
        i = min(int(x), cols - 3)
        j = min(int(y), rows - 3)
        across = keys_weights(x - i)
        down = keys_weights(y - j)
        for k in range(depth):
            total = 0.0
            for r in range(4):
                for c in range(4):
                    total += down[r] * across[c] * field[j - 1 + r, i - 1 + c, k]
            out[n, k] = total


def sample(field: Float, col: ArrayLike, row: ArrayLike) -> Float:
    """Value of a node field between its nodes.

    field: (rows, cols, k). col, row: any shape, in nodes (node i at i; a camera column u lies at
    (u - grid.u_px[0]) / grid.spacing_px). Returns (..., k); NaN outside [1, n - 2] on either axis, where
    the 4 x 4 support does not fit, and where a node of the support is NaN.

    Convention: field is indexed (row, column), positions are given (column, row).
    """
    x, y = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    out = np.empty((x.size, field.shape[2]))
    _sample(np.asarray(field, dtype=np.float64), x.ravel(), y.ravel(), out)
    return out.reshape(*x.shape, field.shape[2])
