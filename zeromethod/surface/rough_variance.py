"""Rough variance of integrated depth at every node, from the multigrid's own lattices; compiled.

A node's depth is as uncertain as the resistance between it and the anchor, edges taken as conductors. Of
that, the surroundings of each size have their share: each octave of a plane of conductors w has ln 2 / (2
pi w). What a lattice of every other node leaves out is so a share of 1 / diagonal of the finer one; and the
coarsest one is solved. (The sum over lattices by J. H. Bramble, J. E. Pasciak and J. Xu, Parallel multilevel
preconditioners, Math. Comp. 55 (1990) 1, doi:10.1090/S0025-5718-1990-1023042-6, as an estimate.) It is within
15 % of the variance times a constant in the open, and up to four times too large at single nodes of holes'
rims: what is left varies so slowly that few nodes say it.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.multigrid import LatticeSolution, plane, prolong, restrict

_MOST_NODES = 400
"""Of the lattice that is solved."""
_FINEST, _COARSER = 4.0 * np.log(2.0) / (2.0 * np.pi), 8.0 / 3.0 * np.log(2.0) / (2.0 * np.pi)
"""Share of an octave over 1 / diagonal: of conductors w alone that is 1 / (4 w), of coarse lattices with
their products over diagonals 3 / (8 w)."""
_BLUR = np.outer((1.0, 2.0, 1.0), (1.0, 2.0, 1.0))
"""Weights of neighbours: between coarse nodes the estimate has steps."""
_GROUND = 1e-9
"""Conductance from every node to a common one, over the largest, without which there is no inverse."""


@numba.njit(cache=True, error_model="numpy")
def _to_anchor(edges: Float, anchor: Float, out: Float) -> None:
    """Resistance between each node of a lattice (rows, cols) and the mean with the anchor's weights.

    edges: (5, rows, cols), all with a border of one node. By Cholesky's factor of a band.
    """
    rows, cols = anchor.shape[0] - 2, anchor.shape[1] - 2
    count, wide = rows * cols, cols + 1
    band = np.zeros((count, wide + 1))
    ground = _GROUND * edges[0].max()
    for k in range(count):
        i, j = 1 + k // cols, 1 + k % cols
        # not the diagonal, by whose rounding there may be no root
        around = edges[1, i, j] + edges[1, i, j - 1] + edges[2, i, j] + edges[2, i - 1, j]
        around += edges[3, i, j] + edges[3, i - 1, j - 1] + edges[4, i, j] + edges[4, i - 1, j + 1]
        band[k, wide] = around + ground
        band[k, wide - 1] = -edges[1, i, j - 1]
        band[k, wide - cols] -= edges[2, i - 1, j]
        band[k, wide - cols - 1] = -edges[3, i - 1, j - 1]
        band[k, wide - cols + 1] -= edges[4, i - 1, j + 1]
    for k in range(count):
        first = max(0, k - wide)
        for m in range(first, k + 1):
            total = band[k, m - k + wide]
            for n in range(max(first, m - wide), m):
                total -= band[k, n - k + wide] * band[m, n - m + wide]
            band[k, m - k + wide] = np.sqrt(total) if m == k else total / band[m, wide]
    half, pull = np.empty(count), np.empty(count)
    for k in range(count):
        half[k] = anchor[1 + k // cols, 1 + k % cols]
    _forward(band, half, 0)
    pull[:] = half
    for k in range(count - 1, -1, -1):
        pull[k] /= band[k, wide]
        for m in range(max(0, k - wide), k):
            pull[m] -= band[k, m - k + wide] * pull[k]
    own = (half * half).sum()
    for k in range(count):
        half[:], half[k] = 0.0, 1.0
        _forward(band, half, k)
        out[1 + k // cols, 1 + k % cols] = (half[k:] * half[k:]).sum() - 2.0 * pull[k] + own


@numba.njit(cache=True, error_model="numpy")
def _forward(band: Float, right: Float, first: int) -> None:
    """Solve with the band's factor (n, wide + 1), in place; the right-hand side is 0 before `first`."""
    wide = band.shape[1] - 1
    for k in range(first, len(right)):
        total = right[k]
        for m in range(max(first, k - wide), k):
            total -= band[k, m - k + wide] * right[m]
        right[k] = total / band[k, wide]


def log_rough_variance(solution: LatticeSolution, anchor: Float) -> Float:
    """Logarithm (rows, cols) of the variance of depth / h against the anchor's mean, up to a constant.

    anchor: weights (rows, cols) that add up to 1. Means nothing at nodes without an edge.
    """
    size, level = solution.size, 0
    weights = np.zeros(size[0, :2])
    weights[1:-1, 1:-1] = anchor
    while (size[level, 0] - 2) * (size[level, 1] - 2) > _MOST_NODES and level + 1 < len(size):
        level += 1
        finer, weights = weights, np.zeros(size[level, :2])
        restrict(plane(solution.interpolation, size, level, 8), finer, weights)
    found = np.zeros(size[level, :2])
    edges = solution.matrix if level == 0 else plane(solution.edges, size, level, 5)
    _to_anchor(edges.astype(np.float64), weights, found)
    for finer_level in range(level - 1, -1, -1):
        # where noise changes by orders of magnitude from node to node, the larger one must not spread
        log = np.log(np.where(found > 0.0, found, 1.0))
        found = np.zeros(size[finer_level, :2])
        prolong(plane(solution.interpolation, size, finer_level + 1, 8), log, found)
        own = plane(solution.inverse, size, finer_level, 1)[0]
        found = np.exp(found) + (_COARSER if finer_level else _FINEST) * own
    known = np.asarray(solution.matrix[0] > 0.0, np.float64)
    log = known * np.log(np.where(found > 0.0, found, 1.0))
    total, count = (
        np.asarray(cv2.filter2D(one, -1, _BLUR, borderType=cv2.BORDER_CONSTANT)) for one in (log, known)
    )
    return np.asarray((total / np.maximum(count, 1.0))[1:-1, 1:-1], np.float64)
