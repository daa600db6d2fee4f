"""Depths and slopes that pressures on contacts make all over the mirror, and the sums of their fit, fast."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from zeromethod.arrays import Float
from zeromethod.contact.loads import SHAPES, Loads

_AWAY, _SIDES = np.array([1.2, 2.5, 5.0]), (7, 5, 3)
"""Half diagonals of a contact beyond which few forces stand for those of all its cells, and how many along
each side; 2e-3 of the slope is lost where they begin, 5e-4 further away."""


_SMOOTH2 = 0.8**2
"""Cells within a contact's border count as spread over so much of their own area."""


def load_fields(loads: Loads, at_mm: Float, spread_mm2: Float, *, within: bool = False) -> Float:
    """Mean depth, 1/mm, and slope along x and y, 1/mm^2, (n, 3, SHAPES) about points (n, 2), mm.

    Of a half-space, in 1 / (pi E*) of a newton, by each of a contact's pressures. spread_mm2: (n, 2)
    variances along x and y of what the means are over: slopes have it to third order, depth has not. within:
    points may lie between the cells.
    """
    low, high = loads.cells.min(axis=0), loads.cells.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    cells, forces = loads.cells - middle, loads.forces
    spread2 = _SMOOTH2 * loads.area_mm2 if within else np.zeros(len(cells))
    own2 = spread2 if within else loads.own2_mm2
    at, fields = at_mm - middle, np.empty((len(at_mm), 3, SHAPES))
    level = np.searchsorted(np.hypot(*half) * _AWAY, np.hypot(at[:, 0], at[:, 1]))
    for k in range(int(level.max(initial=0)) + 1):
        if k > 0:
            # few stand for more as well as these do for all
            points, inverse = _points(_SIDES[k - 1])
            forces, cells = _standing(forces, cells / half, inverse), half * points
            own2 = spread2 = np.zeros(len(cells))
        here = level == k
        if here.any():
            fields[here] = _fields(at[here], spread_mm2[here], cells, forces, own2, spread2)
    return fields


@lru_cache
def _points(count: int) -> tuple[Float, Float]:
    """(count^2, 2) Chebyshev points, row by row, and the inverse of their polynomials' values along a row."""
    points = chebyshev.chebpts1(count)
    x, y = np.meshgrid(points, points)
    inverse = np.linalg.inv(chebyshev.chebvander(points, count - 1))
    return np.stack([x.ravel(), y.ravel()], axis=-1), np.asarray(inverse)


def _standing(forces: Float, unit: Float, inverse: Float) -> Float:
    """(SHAPES, count^2) forces at Chebyshev points that stand for those (SHAPES, cells) of cells, row by row.

    unit: (cells, 2) from -1 to 1. inverse: (count, count) of the polynomials' values at the points.
    """
    along, across = (chebyshev.chebvander(unit[:, k], len(inverse) - 1) @ inverse for k in (0, 1))
    return forces @ (across[:, :, None] * along[:, None]).reshape(len(unit), -1)


def _fields(at: Float, spread: Float, cells: Float, forces: Float, own2: Float, spread2: Float) -> Float:
    """Depths and slopes (n, 3, SHAPES). at, cells: (..., 2) from the middle. forces: (SHAPES, cells).

    spread2: (cells,) these make 1 / s + spread2 / s^3, s^2 = distance^2 + spread2: summed over a plane that
    is 1 / distance, without its peak. Source of such kernels: Beale & Majda 1985, J. Comput. Phys. 58, 188.
    """
    x, y = (at[:, k, None] - cells[:, k] for k in (0, 1))
    near2 = 1 / (x * x + y * y + own2)
    root, part = np.sqrt(near2), spread2 * near2
    pull = -near2 * root * (1 + 3 * part)
    slope_x, slope_y = pull * x, pull * y
    if spread.any():
        wide, high = 0.5 * spread.T[:, :, None] * near2
        xx, yy = 15 * x * x * near2, 15 * y * y * near2
        slope_x *= 1 - wide * (9 - xx) - high * (3 - yy)
        slope_y *= 1 - wide * (3 - xx) - high * (9 - yy)
    return np.stack([one @ forces.T for one in (root * (1 + part), slope_x, slope_y)], axis=1)


def normal_equations(terms: Float, wanted: Float, weight: Float) -> tuple[Float, Float]:
    """(t, t) products of terms (n, t), and (t,) with wanted (n,), each times weight^2 (n,).

    No library's threads change a bit.
    """
    weighted = (terms.T * weight).copy()
    return np.einsum("tn,un->tu", weighted, weighted), np.einsum("tn,n->t", weighted, weight * wanted)


def left_over(terms: Float, wanted: Float, mean: Float) -> Float:
    """(n,) what shares (t,) leave of what is wanted (n,)."""
    return np.asarray(wanted - np.einsum("nt,t->n", terms, mean))


def followed(
    terms: Float,
    weight: Float,
    inverse: Float,
    kept: Float,
    limit: Float,
    slopes: Float,
    share: Float,
    mean: Float,
    passes: int,
) -> Float:
    """Shares (t,) by slopes (2 n,) of another frame: each pass takes what the last says where none is known.

    terms, weight: (2 n, t), (2 n,) of the fit. inverse: (t, t) of its normal equations. kept: (t, t) what it
    makes of its own slopes. limit: (2 n,) beyond which residuals are cut off, but for the first pass. share:
    (n,) of each block that is read.
    """
    read = np.repeat(share, 2)
    known = np.where(read > 0, weight**2, 0.0)
    for k in range(passes):
        left = slopes - read * np.einsum("nt,t->n", terms, mean)
        if k > 0:
            left = np.clip(left, -limit, limit)
        right = np.einsum("nt,n->t", terms, known * left)
        mean = np.einsum("tu,u->t", kept, mean) + np.einsum("tu,u->t", inverse, right)
    return mean
