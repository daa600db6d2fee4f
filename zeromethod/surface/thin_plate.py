"""Thin-plate spline through values at nodes of a lattice, at all its nodes.

On a lattice the kernel r^2 log r is looked up: node by node, a part of one table.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from zeromethod.arrays import Float, Ints

_SINGULAR = 1e-12
"""Pivot over the largest up to which the nodes lie on one line."""


def thin_plate(nodes: Ints, values: Float, rows: int, cols: int) -> Float:
    """Spline (rows, cols) through values (n,) at flat node numbers (n,); their mean where nodes do not say.

    That is for fewer than three, and for nodes on one line.
    """
    count, per = len(nodes), 1.0 / max(rows, cols)
    row, col = np.divmod(nodes, cols)
    down, right = np.arange(1 - rows, rows)[:, None], np.arange(1 - cols, cols)
    r2 = per * per * (down * down + right * right)
    kernel = 0.5 * r2 * np.log(np.where(r2 > 0.0, r2, 1.0))
    matrix = np.zeros((count + 3, count + 3))
    matrix[:count, :count] = kernel[rows - 1 + row - row[:, None], cols - 1 + col - col[:, None]]
    matrix[:count, count:] = np.stack([np.ones(count), per * row, per * col], axis=1)
    matrix[count:, :count] = matrix[:count, count:].T
    factors, order, _ = lapack.dgetrf(matrix)
    pivots = np.abs(np.diag(factors))
    if count < 3 or not np.all(pivots > _SINGULAR * np.maximum.accumulate(pivots)):
        return np.full((rows, cols), values.mean())
    weights, _ = lapack.dgetrs(factors, order, np.concatenate([values, np.zeros(3)]))
    constant, along_rows, along_cols = weights[count:]
    out: Float = constant + per * (along_rows * np.arange(rows)[:, None] + along_cols * np.arange(cols))
    for i, j, weight in zip(row, col, weights[:count], strict=True):
        out += weight * kernel[rows - 1 - i : 2 * rows - 1 - i, cols - 1 - j : 2 * cols - 1 - j]
    return out
