"""Rough variance of integrated depth at every node, from the multigrid's own lattices.

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
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.surface.coarsening import dense
from zeromethod.surface.multigrid import LatticeSolution

_MOST_NODES = 400
"""Of the lattice that is solved."""
_FINEST, _COARSER = 4.0 * np.log(2.0) / (2.0 * np.pi), 8.0 / 3.0 * np.log(2.0) / (2.0 * np.pi)
"""Share of an octave over 1 / diagonal: of conductors w alone that is 1 / (4 w), of coarse lattices with
their products over diagonals 3 / (8 w)."""
_BLUR = np.outer((1.0, 2.0, 1.0), (1.0, 2.0, 1.0))
"""Weights of neighbours: between coarse nodes the estimate has steps."""
_GROUND = 1e-9
"""Conductance from every node to a common one, over the largest, without which there is no inverse."""


def _to_anchor(edges: Float, anchor: Float) -> Float:
    """Resistance between each node of a lattice (rows, cols) and the mean with the anchor's weights.

    edges: (5, rows, cols), all with a border of one node.
    """
    around = edges[1:].sum(axis=0)
    around[:, 1:] += edges[1, :, :-1]
    around[1:] += edges[2, :-1]
    around[1:, 1:] += edges[3, :-1, :-1]
    around[1:, :-1] += edges[4, :-1, 1:]
    # not the diagonal, by whose rounding there may be no inverse
    ground = _GROUND * edges[0].max() or 1.0
    inverse = np.linalg.inv(dense(np.stack([around + ground, *edges[1:]])))
    weights = anchor[1:-1, 1:-1].ravel()
    pull = inverse @ weights
    found = np.diag(inverse) - 2.0 * pull + weights @ pull
    return np.pad(found.reshape(anchor.shape[0] - 2, -1), 1)


def _restricted(p: Single, fine: Float) -> Float:
    """P^T times values of a fine lattice; all with a border of one node (`coarsening`)."""
    rows, cols = 2 * (p.shape[1] - 2), 2 * (p.shape[2] - 2)

    def at(down: int, right: int) -> Float:
        return fine[1 + down : rows + down : 2, 1 + right : cols + right : 2]

    here, east, south = p[:, 1:-1, 1:-1], p[:, 1:-1, :-2], p[:, :-2, 1:-1]
    total = at(0, 0) + here[0] * at(0, 1) + east[1] * at(0, -1) + here[2] * at(1, 0) + south[3] * at(-1, 0)
    total += here[4] * at(1, 1) + east[5] * at(1, -1)
    return np.pad(total + south[6] * at(-1, 1) + p[7, :-2, :-2] * at(-1, -1), 1)


def _prolonged(p: Single, x: Float, shape: tuple[int, ...]) -> Float:
    """P times values of a coarse lattice, on a fine lattice of a shape."""
    out = np.zeros(shape)
    rows, cols = 2 * (x.shape[0] - 2), 2 * (x.shape[1] - 2)
    here, east, south, both = x[1:-1, 1:-1], x[1:-1, 2:], x[2:, 1:-1], x[2:, 2:]
    p = p[:, 1:-1, 1:-1]
    out[1:rows:2, 1:cols:2] = here
    out[1:rows:2, 2 : cols + 1 : 2] = p[0] * here + p[1] * east
    out[2 : rows + 1 : 2, 1:cols:2] = p[2] * here + p[3] * south
    out[2 : rows + 1 : 2, 2 : cols + 1 : 2] = p[4] * here + p[5] * east + p[6] * south + p[7] * both
    return out


def log_rough_variance(solution: LatticeSolution, anchor: Float) -> Float:
    """Logarithm (rows, cols) of the variance of depth / h against the anchor's mean, up to a constant.

    anchor: weights (rows, cols) that add up to 1. Means nothing at nodes without an edge.
    """
    size, level = solution.size, 0
    weights = np.pad(anchor, 1)
    while (size[level, 0] - 2) * (size[level, 1] - 2) > _MOST_NODES and level + 1 < len(size):
        level += 1
        weights = _restricted(solution.planes(solution.interpolation, level, 8), weights)
    edges = solution.matrix if level == 0 else solution.planes(solution.edges, level, 5)
    found = _to_anchor(edges.astype(np.float64), weights)
    for finer_level in range(level - 1, -1, -1):
        # where noise changes by orders of magnitude from node to node, the larger one must not spread
        log = np.log(np.where(found > 0.0, found, 1.0))
        p = solution.planes(solution.interpolation, finer_level + 1, 8)
        found = np.exp(_prolonged(p, log, tuple(size[finer_level, :2])))
        own = solution.planes(solution.inverse, finer_level, 1)[0]
        found += (_COARSER if finer_level else _FINEST) * own
    known = np.asarray(solution.matrix[0] > 0.0, np.float64)
    log = known * np.log(np.where(found > 0.0, found, 1.0))
    total, count = (
        np.asarray(cv2.filter2D(one, -1, _BLUR, borderType=cv2.BORDER_CONSTANT)) for one in (log, known)
    )
    return np.asarray((total / np.maximum(count, 1.0))[1:-1, 1:-1], np.float64)
