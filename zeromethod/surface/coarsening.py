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

from zeromethod.arrays import Float, Mask
from zeromethod.kernels import kernel, read

WAYS = (0, 1), (1, 0), (1, 1), (1, -1)
"""Rows and columns from a node to those at the ends of its edges."""
_ENDS = np.array([(0, 0), *WAYS])


def _shares(one: Float, other: Float, there: Mask) -> tuple[Float, Float]:
    """Weights of two neighbours, in all 1; half each for a node that neither has an edge to."""
    one, other = np.maximum(one, 0.0), np.maximum(other, 0.0)
    tied = one + other > 0.0
    total = np.where(tied, one + other, 1.0)
    return np.where(tied, one / total, 0.5 * there), np.where(tied, other / total, 0.5 * there)


def interpolation(a: Float) -> Float:
    """Weights P (8, ...) of the coarse nodes, from the fine ones' edges (5, ...); they keep constants."""
    rows, cols = (a.shape[1] - 1) // 2, (a.shape[2] - 1) // 2
    planes = [*a[:4], np.pad(a[4], ((0, 0), (0, 1)))]

    def at(number: int, down: int, right: int) -> Float:
        """Diagonal or edges of the fine nodes so far from the coarse ones."""
        found: Float = planes[number][1 + down : 2 * rows + down : 2, 1 + right : 2 * cols + right : 2]
        return found

    p = np.zeros((8, rows + 2, cols + 2))
    inner = p[:, 1:-1, 1:-1]
    west, east = at(1, 0, 0) + at(3, -1, 0) + at(4, 0, 1), at(1, 0, 1) + at(3, 0, 1) + at(4, -1, 2)
    inner[:2] = _shares(west, east, at(0, 0, 1) > 0.0)
    north, south = at(2, 0, 0) + at(3, 0, -1) + at(4, 0, 1), at(2, 1, 0) + at(3, 1, 0) + at(4, 1, 0)
    inner[2:4] = _shares(north, south, at(0, 1, 0) > 0.0)
    # beyond the last column and row there is no coarse node
    for own, next_one in (inner[:2, :, -1], inner[2:4, -1]):
        own[next_one > 0.0], next_one[:] = 1.0, 0.0
    north, south, west, east = at(2, 0, 1), at(2, 1, 1), at(1, 1, 0), at(1, 1, 1)
    corners = at(3, 0, 0), at(4, 0, 2), at(4, 1, 1), at(3, 1, 1)
    total = north + south + west + east + sum(corners)
    here, to_east, to_south = p[:4, 1:-1, 1:-1], p[:4, 1:-1, 2:], p[:4, 2:, 1:-1]
    ways = (
        north * here[0] + west * here[2],
        north * here[1] + east * to_east[2],
        south * to_south[0] + west * here[3],
        south * to_south[1] + east * to_east[3],
    )
    for number, (corner, way) in enumerate(zip(corners, ways, strict=True), 4):
        np.divide(corner + way, total, out=inner[number], where=total > 0.0)
    return p


def _columns(p: Float) -> Float:
    """Columns (3, 3, rows, cols) of P: weights of the fine nodes around each coarse node, without border."""
    rows, cols = p.shape[1] - 2, p.shape[2] - 2
    places = (
        ((7, 0, 0), (3, 0, 1), (6, 0, 1)),
        ((1, 1, 0), None, (0, 1, 1)),
        ((5, 1, 0), (2, 1, 1), (4, 1, 1)),
    )
    out = np.ones((3, 3, rows, cols))
    for y, x in np.ndindex(3, 3):
        place = places[y][x]
        if place is not None:
            number, i, j = place
            out[y, x] = p[number, i : i + rows, j : j + cols]
    return out


@kernel(read(numba.float64, 3), read(numba.float64, 4), numba.float64[:, ::1], numba.float64[:, :, ::1])
def _products(a: Any, own: Any, spread: Any, out: Any) -> None:
    """Edges and diagonal (5, rows, cols) of P^T A P, without border, from the `_columns` of P.

    spread: (5, 5) scratch, a column of A P.
    """
    rows, cols = out.shape[1], out.shape[2]
    for i in range(rows):
        for j in range(cols):
            for place in range(25):
                spread[place // 5, place % 5] = 0.0
            for place in range(9):
                y, x = place // 3, place % 3
                k, m, weight = 2 * i + y, 2 * j + x, own[y, x, i, j]
                if weight != 0.0:
                    spread[y + 1, x + 1] += a[0, k, m] * weight
                    spread[y + 1, x + 2] -= a[1, k, m] * weight
                    spread[y + 1, x] -= a[1, k, m - 1] * weight
                    spread[y + 2, x + 1] -= a[2, k, m] * weight
                    spread[y, x + 1] -= a[2, k - 1, m] * weight
                    spread[y + 2, x + 2] -= a[3, k, m] * weight
                    spread[y, x] -= a[3, k - 1, m - 1] * weight
                    spread[y + 2, x] -= a[4, k, m] * weight
                    spread[y, x + 2] -= a[4, k - 1, m + 1] * weight
            for number in range(5):
                down, right = _ENDS[number, 0], _ENDS[number, 1]
                if i + down < rows and 0 <= j + right < cols:
                    total = 0.0
                    for place in range(9):
                        y, x = place // 3, place % 3
                        row, col = y + 1 + 2 * down, x + 1 + 2 * right
                        if row < 5 and 0 <= col < 5:
                            total += own[y, x, i + down, j + right] * spread[row, col]
                    out[number, i, j] = total if number == 0 else -total


def coarse(a: Float, p: Float) -> Float:
    """Edges and diagonal (5, ...) of P^T A P."""
    inner = np.zeros((5, p.shape[1] - 2, p.shape[2] - 2))
    _products(a, _columns(p), np.empty((5, 5)), inner)
    return np.pad(inner, ((0, 0), (1, 1), (1, 1)))


def dense(a: Float) -> Float:
    """Matrix (nodes, nodes) of a lattice of few nodes."""
    rows, cols = a.shape[1] - 2, a.shape[2] - 2
    node = np.arange(rows * cols).reshape(rows, cols)
    out = np.diag(a[0, 1:-1, 1:-1].ravel())
    for edges, (down, right) in zip(a[1:, 1:-1, 1:-1], WAYS, strict=True):
        west, east = slice(None, cols - abs(right)), slice(abs(right), None)
        first, second = (east, west) if right < 0 else (west, east)
        here, there = node[: rows - down, first], node[down:, second]
        out[here, there] = out[there, here] = -edges[: rows - down, first]
    return out
