"""Coarse lattices of a graph Laplacian (`multigrid`): every other node, and what it stands for.

All arrays have a border of one node, without edges. Of a lattice (5, rows, cols): the diagonal, and the edges
to the east, south, south-east and south-west. Of the interpolation P (8, rows, cols), by coarse node: weights
of it and the next one to the east for the fine node between; of it and the next one to the south; and of all
four (itself, east, south, south-east) for the fine node in their middle.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from zeromethod.arrays import Float


@numba.njit(cache=True, error_model="numpy")
def _shares(one: float, other: float, there: bool) -> tuple[float, float]:
    """Weights of two neighbours, in all 1; half each for a node that neither has an edge to."""
    one, other = max(one, 0.0), max(other, 0.0)
    if one + other > 0.0:
        return one / (one + other), other / (one + other)
    return (0.5, 0.5) if there else (0.0, 0.0)


@numba.njit(cache=True, error_model="numpy")
def interpolation(a: Any, p: Any) -> None:
    """Weights P of the coarse nodes, from the edges of the fine ones; they keep constants."""
    rows, cols = a.shape[1] - 2, a.shape[2] - 2
    for i in range(1, p.shape[1] - 1):
        k = 2 * i - 1
        for j in range(1, p.shape[2] - 1):
            m = 2 * j - 1
            if m < cols:
                west = a[1, k, m] + a[3, k - 1, m] + a[4, k, m + 1]
                east = a[1, k, m + 1] + a[3, k, m + 1] + a[4, k - 1, m + 2]
                p[0, i, j], p[1, i, j] = _shares(west, east, a[0, k, m + 1] > 0.0)
            if k < rows:
                north = a[2, k, m] + a[3, k, m - 1] + a[4, k, m + 1]
                south = a[2, k + 1, m] + a[3, k + 1, m] + a[4, k + 1, m]
                p[2, i, j], p[3, i, j] = _shares(north, south, a[0, k + 1, m] > 0.0)
    # beyond the last column and row there is no coarse node
    for i in range(1, p.shape[1] - 1):
        j = p.shape[2] - 2
        if p[1, i, j] > 0.0:
            p[0, i, j], p[1, i, j] = 1.0, 0.0
    for j in range(1, p.shape[2] - 1):
        i = p.shape[1] - 2
        if p[3, i, j] > 0.0:
            p[2, i, j], p[3, i, j] = 1.0, 0.0
    for i in range(1, p.shape[1] - 1):
        k = 2 * i
        for j in range(1, p.shape[2] - 1):
            m = 2 * j
            if m > cols or k > rows:
                continue
            north, south, west, east = a[2, k - 1, m], a[2, k, m], a[1, k, m - 1], a[1, k, m]
            nw, se, ne, sw = a[3, k - 1, m - 1], a[3, k, m], a[4, k - 1, m + 1], a[4, k, m]
            total = north + south + west + east + nw + se + ne + sw
            if total > 0.0:
                p[4, i, j] = (nw + north * p[0, i, j] + west * p[2, i, j]) / total
                p[5, i, j] = (ne + north * p[1, i, j] + east * p[2, i, j + 1]) / total
                p[6, i, j] = (sw + south * p[0, i + 1, j] + west * p[3, i, j]) / total
                p[7, i, j] = (se + south * p[1, i + 1, j] + east * p[3, i, j + 1]) / total


@numba.njit(cache=True, error_model="numpy")
def _column(p: Any, i: int, j: int, out: Any) -> None:
    """Column (3, 3) of P: the fine nodes around the coarse node (i, j)."""
    out[0, 0], out[0, 1], out[0, 2] = p[7, i - 1, j - 1], p[3, i - 1, j], p[6, i - 1, j]
    out[1, 0], out[1, 1], out[1, 2] = p[1, i, j - 1], 1.0, p[0, i, j]
    out[2, 0], out[2, 1], out[2, 2] = p[5, i, j - 1], p[2, i, j], p[4, i, j]


@numba.njit(cache=True, error_model="numpy")
def _scatter(a: Any, k: int, m: int, value: float, out: Any) -> None:
    """Add A's column of the node (k, m), inside the border, times a value to its neighbourhood."""
    out[2, 2] += a[0, k, m] * value
    out[2, 3] -= a[1, k, m] * value
    out[2, 1] -= a[1, k, m - 1] * value
    out[3, 2] -= a[2, k, m] * value
    out[1, 2] -= a[2, k - 1, m] * value
    out[3, 3] -= a[3, k, m] * value
    out[1, 1] -= a[3, k - 1, m - 1] * value
    out[3, 1] -= a[4, k, m] * value
    out[1, 3] -= a[4, k - 1, m + 1] * value


@numba.njit(cache=True, error_model="numpy")
def coarse(a: Any, p: Any, out: Any) -> None:
    """Edges and diagonal of P^T A P."""
    own, other, spread = np.empty((3, 3)), np.empty((3, 3)), np.empty((7, 7))
    rows, cols = out.shape[1] - 2, out.shape[2] - 2
    for i in range(1, rows + 1):
        for j in range(1, cols + 1):
            _column(p, i, j, own)
            spread[:] = 0.0
            for y in range(3):
                for x in range(3):
                    if own[y, x] != 0.0:
                        _scatter(a, 2 * i - 2 + y, 2 * j - 2 + x, own[y, x], spread[y : y + 5, x : x + 5])
            for number, (down, right) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1), (1, -1))):
                if i + down > rows or not 0 < j + right <= cols:
                    continue
                _column(p, i + down, j + right, other)
                total = 0.0
                for y in range(3):
                    for x in range(3):
                        row, col = y + 2 + 2 * down, x + 2 + 2 * right
                        if row < 7 and 0 <= col < 7:
                            total += other[y, x] * spread[row, col]
                out[number, i, j] = total if number == 0 else -total


def dense(a: Float) -> Float:
    """Matrix (nodes, nodes) of a lattice of few nodes."""
    rows, cols = a.shape[1] - 2, a.shape[2] - 2
    out = np.zeros((rows, cols, rows, cols))
    for i, j in np.ndindex(rows, cols):
        out[i, j, i, j] = a[0, i + 1, j + 1]
        for number, (down, right) in enumerate(((0, 1), (1, 0), (1, 1), (1, -1)), 1):
            if i + down < rows and 0 <= j + right < cols:
                value = -a[number, i + 1, j + 1]
                out[i, j, i + down, j + right] = out[i + down, j + right, i, j] = value
    return out.reshape(rows * cols, rows * cols)
