"""Solver of graph Laplacians on lattices: conjugate gradients, preconditioned by a multigrid cycle.

Coarse lattices take every other node, with interpolation by the weights of the edges themselves, so that it
stops at holes, and products P^T A P on nine points (J. E. Dendy, Black box multigrid, J. Comput. Phys. 48
(1982) 366, doi:10.1016/0021-9991(82)90057-2). Building them takes a tenth of a factorisation, so that a mask
may change in every frame, and time grows as the number of nodes. The cycle works in single precision, which
changes how fast the gradients converge and not to what.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.kernels import kernel, piece, read
from zeromethod.rounding import REORDERED
from zeromethod.surface.coarsening import WAYS, coarse, dense, interpolation

_FEWEST = 5
"""Nodes along an axis of the coarsest lattice, which is solved directly, at most."""
_NULL = 1e-7
"""Eigenvalue over the largest up to which a combination of the coarsest nodes counts as free."""
_STEPS = 0.562, 1.389
"""Lengths of the two damped steps that smooth: Chebyshev's, for eigenvalues of 0.5 to 2 over the diagonal."""
_ROUNDING = 1e-14
"""Diagonal over the finest lattice's largest up to which a node has no edges but what rounding left."""
EXACT = 1e-11
"""Share of the error that is left by default."""
_MOST_CYCLES = 300


_fast = piece(fastmath=REORDERED)


@_fast
def _left(edges: Any, five: bool, b: Any, x: Any, out: Any) -> None:
    """What A x leaves of b; edges: (diagonal, east, south, south-east, south-west).

    All have a border of one node, without edges, so that rows are run through as one line.
    """
    width = b.shape[1]
    size = b.size - 2 * width - 2
    a, value = edges.reshape(edges.shape[0], b.size), x.reshape(b.size)
    at, above = slice(width + 1, width + 1 + size), slice(1, 1 + size)
    c, own, given, left = a[0][at], value[at], b.reshape(b.size)[at], out.reshape(b.size)[at]
    east, from_west = a[1][at], a[1][width : width + size]
    to_east, to_west = value[width + 2 : width + 2 + size], value[width : width + size]
    for k in range(size):
        left[k] = given[k] - c[k] * own[k] + east[k] * to_east[k] + from_west[k] * to_west[k]
    south, from_north = a[2][at], a[2][above]
    down, up = value[2 * width + 1 : 2 * width + 1 + size], value[above]
    for k in range(size):
        left[k] += south[k] * down[k] + from_north[k] * up[k]
    if five:
        return
    for row, col, number in ((width, 1, 3), (width, -1, 4)):
        to = row + col
        edge, back = a[number][at], a[number][width + 1 - to : width + 1 - to + size]
        ahead, behind = (
            value[width + 1 + to : width + 1 + to + size],
            value[width + 1 - to : width + 1 - to + size],
        )
        for k in range(size):
            left[k] += edge[k] * ahead[k] + back[k] * behind[k]


@_fast
def _step(inverse: Any, length: Any, r: Any, x: Any, first: bool) -> None:
    """A damped step: x += length * r / diagonal; the first one from 0."""
    per, left, value = inverse.reshape(x.size), r.reshape(x.size), x.reshape(x.size)
    for k in range(x.size):
        before = np.float32(0.0) if first else value[k]
        value[k] = before + length * per[k] * left[k]


@piece
def _restrict(p: Any, r: Any, out: Any) -> None:
    """P^T r."""
    for i in range(1, out.shape[0] - 1):
        k = 2 * i - 1
        for j in range(1, out.shape[1] - 1):
            m = 2 * j - 1
            total = r[k, m] + p[0, i, j] * r[k, m + 1] + p[1, i, j - 1] * r[k, m - 1]
            total += p[2, i, j] * r[k + 1, m] + p[3, i - 1, j] * r[k - 1, m]
            total += p[4, i, j] * r[k + 1, m + 1] + p[5, i, j - 1] * r[k + 1, m - 1]
            out[i, j] = total + p[6, i - 1, j] * r[k - 1, m + 1] + p[7, i - 1, j - 1] * r[k - 1, m - 1]


@piece
def _prolong(p: Any, x: Any, out: Any) -> None:
    """Add P x."""
    for i in range(1, x.shape[0] - 1):
        k = 2 * i - 1
        for j in range(1, x.shape[1] - 1):
            m = 2 * j - 1
            a, b, c, d = x[i, j], x[i, j + 1], x[i + 1, j], x[i + 1, j + 1]
            out[k, m] += a
            out[k, m + 1] += p[0, i, j] * a + p[1, i, j] * b
            out[k + 1, m] += p[2, i, j] * a + p[3, i, j] * c
            out[k + 1, m + 1] += p[4, i, j] * a + p[5, i, j] * b + p[6, i, j] * c + p[7, i, j] * d


@piece
def _planes(flat: Any, size: Any, level: int, planes: int) -> Any:
    """Planes of one lattice out of an array that holds those of all, one lattice after the other."""
    rows, cols = size[level, 0], size[level, 1]
    at = planes * size[level, 2]
    return flat[at : at + planes * rows * cols].reshape(planes, rows, cols)


@piece
def _cycle(size: Any, edges: Any, inverse: Any, p: Any, coarsest: Any, b: Any, x: Any, r: Any) -> None:
    """One V-cycle from 0, from b to x of the finest lattice; the others', and r, are scratch."""
    last = len(size) - 1
    first, second = np.float32(_STEPS[0]), np.float32(_STEPS[1])
    for level in range(last):
        a, per = _planes(edges, size, level, 5), _planes(inverse, size, level, 1)[0]
        given, found = _planes(b, size, level, 1)[0], _planes(x, size, level, 1)[0]
        left = _planes(r, size, level, 1)[0]
        _step(per, first, given, found, True)
        _left(a, level == 0, given, found, left)
        _step(per, second, left, found, False)
        _left(a, level == 0, given, found, left)
        _restrict(_planes(p, size, level + 1, 8), left, _planes(b, size, level + 1, 1)[0])
    given, found = _planes(b, size, last, 1)[0], _planes(x, size, last, 1)[0]
    cols = given.shape[1] - 2
    for k in range(len(coarsest)):
        total = np.float32(0.0)
        for m in range(len(coarsest)):
            total += coarsest[k, m] * given[1 + m // cols, 1 + m % cols]
        found[1 + k // cols, 1 + k % cols] = total
    for level in range(last - 1, -1, -1):
        a, per = _planes(edges, size, level, 5), _planes(inverse, size, level, 1)[0]
        given, found = _planes(b, size, level, 1)[0], _planes(x, size, level, 1)[0]
        left = _planes(r, size, level, 1)[0]
        _prolong(_planes(p, size, level + 1, 8), _planes(x, size, level + 1, 1)[0], found)
        _left(a, level == 0, given, found, left)
        _step(per, second, left, found, False)
        _left(a, level == 0, given, found, left)
        _step(per, first, left, found, False)


_ALL = read(numba.float32, 1)


@kernel(
    read(numba.int64, 2), read(numba.float64, 3), _ALL, _ALL, _ALL, read(numba.float32, 2), numba.float64,
    numba.int64, numba.float32[:, ::1], numba.float64[:, :, ::1], numba.float64[:, ::1],
    fastmath=REORDERED,
)  # fmt: skip
def _gradients(
    size: Any, matrix: Any, edges: Any, inverse: Any, p: Any, coarsest: Any, share: float, most_cycles: int,
    single: Any, double: Any, out: Any,
) -> None:  # fmt: skip
    """Conjugate gradients, into `out`, until less than `share` is left; NaN where more stays.

    out: (rows, cols), 0. double: (4, rows, cols), the right-hand side first, else 0. single: (3, nodes of all
    lattices), 0.
    """
    b, x, r = single[0], single[1], single[2]
    left, along, bent = double[0].reshape(out.size), double[1].reshape(out.size), double[2].reshape(out.size)
    found, energy, first = out.reshape(out.size), 0.0, 0.0
    for cycle in range(most_cycles):
        for k in range(out.size):
            b[k] = left[k]
        _cycle(size, edges, inverse, p, coarsest, b, x, r)
        before, energy = energy, 0.0
        for k in range(out.size):
            energy += left[k] * np.float64(x[k])
        if cycle == 0:
            first = energy
        if not energy > share * share * first:
            if energy >= -share * share * first:
                return
            break
        turn = energy / before if cycle else 0.0
        # what is left once this step is taken, if it helps as much as the one before
        last = cycle > 0 and energy * turn < share * share * first
        for k in range(out.size):
            along[k] = x[k] + turn * along[k]
        _left(matrix, True, double[3], double[1], double[2])
        bend = 0.0
        for k in range(out.size):
            bend += along[k] * bent[k]
        length = -energy / bend
        for k in range(out.size):
            found[k] += length * along[k]
            left[k] += length * bent[k]
        if last:
            return
    for k in range(out.size):
        found[k] = np.nan


def _flat(parts: list[Float], places: NDArray[np.intp]) -> NDArray[np.float32]:
    """All parts in one array, each from its place on; the last place is the end."""
    out = np.zeros(places[-1], np.float32)
    for one, at in zip(parts, places[:-1], strict=True):
        out[at : at + one.size] = one.ravel()
    return out


def _inverse(edges: Float) -> Float:
    """1 / diagonal; 0 of a node without edges.

    Edges of the wrong sign, which thin parts of an island get on coarse lattices, are added to the diagonal:
    else eigenvalues exceed 2, and the steps that should smooth grow (A. H. Baker et al., Multigrid smoothers
    for ultraparallel computing, SIAM J. Sci. Comput. 33 (2011) 2864, doi:10.1137/100798806).
    """
    diagonal = edges[0]
    if edges.min() < 0.0:
        wrong = np.maximum(-edges[1:], 0.0)
        others = [np.roll(one, way, (0, 1)) for one, way in zip(wrong, WAYS, strict=True)]
        diagonal = diagonal + wrong.sum(axis=0) + np.sum(others, axis=0)
    return np.asarray(np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0))


@dataclass(frozen=True, slots=True)
class LatticeSolution:
    """Lattices, from fine to coarse, of one A; see the module.

    size: (lattices, 3) rows and columns with a border of one node, and nodes of all before. matrix: (5, rows,
    cols) diagonal and edges of A; edges, inverse (of the diagonal), interpolation: of all lattices, flat.
    coarsest: the pseudoinverse of its matrix.
    """

    size: NDArray[np.intp]
    matrix: Float
    edges: NDArray[np.float32]
    inverse: NDArray[np.float32]
    interpolation: NDArray[np.float32]
    coarsest: NDArray[np.float32]

    @classmethod
    def of(cls, across: Float, down: Float) -> LatticeSolution:
        """Of edge weights (rows, cols-1) and (rows-1, cols), 0 = no edge."""
        rows, cols = across.shape[0], down.shape[1]
        matrix = np.zeros((5, rows + 2, cols + 2))
        matrix[1, 1:-1, 1:-2], matrix[2, 1:-2, 1:-1] = across, down
        matrix[0, 1:-1, 1:-1] = (
            matrix[1, 1:-1, 1:-1] + matrix[1, 1:-1, :-2] + matrix[2, 1:-1, 1:-1] + matrix[2, :-2, 1:-1]
        )
        lattices, between, least = [matrix], [np.zeros(0)], _ROUNDING * matrix[0].max()
        while max(rows, cols) > _FEWEST:
            rows, cols = (rows + 1) // 2, (cols + 1) // 2
            p = interpolation(lattices[-1])
            coarser = coarse(lattices[-1], p)
            # an island within one coarse node has no edge to others: what is left would be inverted, too
            coarser *= coarser[0] > least
            lattices.append(coarser)
            between.append(p)
        sizes = [one.shape[1:] for one in lattices]
        before = np.cumsum([0, *(m * n for m, n in sizes)])
        inverse = [_inverse(a) for a in lattices]
        return cls(
            np.array([(*one, at) for one, at in zip(sizes, before[:-1], strict=True)]),
            matrix,
            _flat(lattices, 5 * before),
            _flat(inverse, before),
            _flat(between, 8 * before),
            np.linalg.pinv(dense(lattices[-1]), rcond=_NULL, hermitian=True).astype(np.float32),
        )

    def solve(self, rhs: Float, share: float = EXACT, most_cycles: int = _MOST_CYCLES) -> Float:
        """D (..., rows, cols), up to a constant, for right-hand sides b (..., rows, cols) that add up to 0.

        share: of the energy's root that may be left. most_cycles: even a comb of single nodes takes fewer.
        NaN everywhere if more is left after these.
        """
        lattices = self.size, self.matrix, self.edges, self.inverse, self.interpolation, self.coarsest
        solutions = np.empty(rhs.shape)
        for place in np.ndindex(rhs.shape[:-2]):
            single, double = (
                np.zeros((3, self.inverse.size), np.float32),
                np.zeros((5, *self.matrix.shape[1:])),
            )
            double[0, 1:-1, 1:-1] = rhs[place]
            _gradients(*lattices, share, most_cycles, single, double[:4], double[4])
            solutions[place] = double[4, 1:-1, 1:-1]
        return solutions

    def planes(self, flat: NDArray[np.float32], level: int, count: int) -> NDArray[np.float32]:
        """Planes (count, rows, cols) of one lattice out of the flat array of all."""
        rows, cols, before = self.size[level]
        return flat[count * before : count * (before + rows * cols)].reshape(count, rows, cols)
