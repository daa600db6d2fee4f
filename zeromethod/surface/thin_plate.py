"""Thin-plate spline through values at nodes of a lattice, at all its nodes; compiled.

Compiled, its sums are taken in the same order on every machine's threads, which those of a library are not;
and on a lattice the kernel r^2 log r is looked up, which takes a twentieth of the time.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Ints

_SINGULAR = 1e-12
"""Pivot over the largest up to which the nodes lie on one line."""


@numba.njit(cache=True, error_model="numpy")
def _solve(matrix: Float, right: Float) -> bool:
    """Solve in place, by elimination with partial pivoting; False where the matrix is singular."""
    count, largest = len(right), 0.0
    for k in range(count):
        best = k + int(np.argmax(np.abs(matrix[k:, k])))
        for m in range(k, count):
            matrix[k, m], matrix[best, m] = matrix[best, m], matrix[k, m]
        right[k], right[best] = right[best], right[k]
        pivot = matrix[k, k]
        largest = max(largest, abs(pivot))
        if not abs(pivot) > _SINGULAR * largest:
            return False
        for i in range(k + 1, count):
            share = matrix[i, k] / pivot
            for m in range(k + 1, count):
                matrix[i, m] -= share * matrix[k, m]
            right[i] -= share * right[k]
    for k in range(count - 1, -1, -1):
        total = right[k]
        for m in range(k + 1, count):
            total -= matrix[k, m] * right[m]
        right[k] = total / matrix[k, k]
    return True


@numba.njit(cache=True, error_model="numpy")
def thin_plate(nodes: Ints, values: Float, rows: int, cols: int) -> Float:
    """Spline (rows, cols) through values (n,) at flat node numbers (n,); their mean where nodes do not say.

    That is for fewer than three, and for nodes on one line.
    """
    count, per = len(nodes), 1.0 / max(rows, cols)
    # r^2 log r by how far apart, columns from -(cols - 1) on
    kernel = np.zeros((rows, 2 * cols - 1))
    for i in range(rows):
        for j in range(2 * cols - 1):
            r2 = per * per * (i * i + (j - cols + 1) ** 2)
            kernel[i, j] = 0.5 * r2 * np.log(r2) if r2 > 0.0 else 0.0
    matrix, right = np.zeros((count + 3, count + 3)), np.zeros(count + 3)
    for k in range(count):
        row, col = nodes[k] // cols, nodes[k] % cols
        right[k] = values[k]
        for m in range(count):
            matrix[k, m] = kernel[abs(nodes[m] // cols - row), nodes[m] % cols - col + cols - 1]
        for m, value in enumerate((1.0, per * row, per * col)):
            matrix[k, count + m] = matrix[count + m, k] = value
    out = np.empty((rows, cols))
    if count < 3 or not _solve(matrix, right):
        out[:] = values.mean()
        return out
    for i in range(rows):
        for j in range(cols):
            out[i, j] = right[count] + per * (right[count + 1] * i + right[count + 2] * j)
        for k in range(count):
            row, col = nodes[k] // cols, nodes[k] % cols
            weight, line = right[k], kernel[abs(row - i)]
            for j in range(cols):
                out[i, j] += weight * line[j - col + cols - 1]
    return out
