"""Depths and slopes that pressures on contacts make all over the mirror, and the sums of their fit, fast."""

from __future__ import annotations

from functools import lru_cache

import numba
import numpy as np
from numpy.polynomial import chebyshev

from zeromethod.arrays import Float
from zeromethod.contact.loads import SHAPES, Loads

_STANDING = ((1.2, 7), (2.5, 5), (5.0, 3))
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
    spread2 = _SMOOTH2 * loads.area_mm2 if within else np.zeros(len(loads.cells))
    own2 = [spread2 if within else loads.own2_mm2]
    cells, forces = [loads.cells - middle], [loads.forces.T.copy()]
    for _, count in _STANDING:
        points, inverse = _points(count)
        # few stand for more as well as these do for all
        forces.append(_standing(forces[-1], cells[-1] / half, inverse))
        cells.append(half * points)
        own2.append(np.zeros(count**2))
    starts = np.cumsum([0, *(len(each) for each in own2)])
    away = np.array([np.hypot(*half) * away for away, _ in _STANDING])
    everything = np.concatenate(cells).T.copy(), np.concatenate(own2), np.concatenate(forces)
    return np.asarray(_fields(at_mm - middle, spread_mm2, *everything, spread2, starts, away))


@lru_cache
def _points(count: int) -> tuple[Float, Float]:
    """(count^2, 2) Chebyshev points, row by row, and the inverse of their polynomials' values along a row."""
    points = chebyshev.chebpts1(count)
    x, y = np.meshgrid(points, points)
    inverse = np.linalg.inv(chebyshev.chebvander(points, count - 1))
    return np.stack([x.ravel(), y.ravel()], axis=-1), np.asarray(inverse)


@numba.njit(cache=True, nogil=True)
def _standing(forces: Float, unit: Float, inverse: Float) -> Float:
    """(count^2, SHAPES) forces at Chebyshev points that stand for those (cells, SHAPES) of cells, row by row.

    unit: (cells, 2) from -1 to 1. inverse: (count, count) of the polynomials' values at the points.
    """
    count = len(inverse)
    out = np.zeros((count * count, SHAPES))
    value, share = np.ones(count), np.empty((2, count))
    for c in range(len(unit)):
        for k in range(2):
            value[1] = unit[c, k]
            for p in range(2, count):
                value[p] = 2 * unit[c, k] * value[p - 1] - value[p - 2]
            for a in range(count):
                share[k, a] = 0.0
                for p in range(count):
                    share[k, a] += value[p] * inverse[p, a]
        own = forces[c]
        for b in range(count):
            for a in range(count):
                part, point = share[1, b] * share[0, a], out[b * count + a]
                for s in range(SHAPES):
                    point[s] += part * own[s]
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fields(
    at: Float,
    spread: Float,
    cells: Float,
    own2: Float,
    forces: Float,
    spread2: Float,
    starts: Float,
    away: Float,
) -> Float:
    """Depths and slopes; at, cells: from the middle. forces: (cells, SHAPES).

    starts: first cell of each set; beyond `away` the next one counts. spread2: of the first set's cells,
    which make 1 / s + spread2 / s^3, s^2 = distance^2 + spread2: summed over a plane that is 1 / distance,
    without its peak. Source of such kernels: Beale & Majda 1985, J. Comput. Phys. 58, 188.
    """
    out = np.zeros((len(at), 3, SHAPES))
    near = np.empty((3, len(own2)))
    for n in range(len(at)):
        distance = np.sqrt(at[n, 0] ** 2 + at[n, 1] ** 2)
        level = 0
        while level < len(away) and distance > away[level]:
            level += 1
        first, count = starts[level], starts[level + 1] - starts[level]
        wide, high = 0.5 * spread[n, 0], 0.5 * spread[n, 1]
        # in two loops, as each is done for some cells at once
        for c in range(count):
            x, y = at[n, 0] - cells[0, first + c], at[n, 1] - cells[1, first + c]
            near2 = 1.0 / (x * x + y * y + own2[first + c])
            root, part = np.sqrt(near2), spread2[c] * near2 if level == 0 else 0.0
            near[0, c] = root * (1.0 + part)
            pull = -near2 * root * (1.0 + 3.0 * part)
            xx, yy = 15.0 * x * x * near2, 15.0 * y * y * near2
            near[1, c] = pull * x * (1.0 - near2 * (wide * (9.0 - xx) + high * (3.0 - yy)))
            near[2, c] = pull * y * (1.0 - near2 * (wide * (3.0 - xx) + high * (9.0 - yy)))
        for c in range(count):
            for k in range(3):
                for s in range(SHAPES):
                    out[n, k, s] += near[k, c] * forces[first + c, s]
    return out


@numba.njit(cache=True, nogil=True)
def normal_equations(terms: Float, wanted: Float, weight: Float) -> tuple[Float, Float]:
    """(t, t) products of terms (n, t), and (t,) with wanted (n,), each times weight^2 (n,).

    No library's threads change a bit.
    """
    count = terms.shape[1]
    normal, right = np.zeros((count, count)), np.zeros(count)
    for n in range(len(terms)):
        for t in range(count):
            part = weight[n] * weight[n] * terms[n, t]
            for u in range(t + 1):
                normal[t, u] += part * terms[n, u]
            right[t] += part * wanted[n]
    for t in range(count):
        for u in range(t):
            normal[u, t] = normal[t, u]
    return normal, right


@numba.njit(cache=True, nogil=True)
def left_over(terms: Float, wanted: Float, mean: Float) -> Float:
    """(n,) what shares (t,) leave of what is wanted (n,)."""
    left = wanted.copy()
    for n in range(len(terms)):
        for t in range(len(mean)):
            left[n] -= terms[n, t] * mean[t]
    return left


@numba.njit(cache=True, nogil=True)
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
    count = len(mean)
    for p in range(passes):
        right = np.zeros(count)
        for n in range(len(slopes)):
            read = share[n // 2]
            if read == 0.0:
                continue
            left = slopes[n]
            for t in range(count):
                left -= read * terms[n, t] * mean[t]
            if p > 0:
                left = min(max(left, -limit[n]), limit[n])
            left *= weight[n] * weight[n]
            for t in range(count):
                right[t] += terms[n, t] * left
        found = np.zeros(count)
        for t in range(count):
            for u in range(count):
                found[t] += kept[t, u] * mean[u] + inverse[t, u] * right[u]
        mean = found
    return mean


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    line, two, one, place = np.ones(1), np.ones(2), np.ones((1, 1)), np.ones((1, 2))
    forces = np.ones((1, SHAPES))
    _standing(forces, place, np.ones((2, 2)))
    _fields(np.zeros((1, 2)), place, place.T.copy(), line, forces, line, np.array([0, 1]), line)
    normal_equations(one, line, line)
    left_over(one, line, line)
    followed(place.T.copy(), two, one, one, two, two, line, line, 1)
