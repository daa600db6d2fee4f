"""Round dents to start a fit from: where slopes meet, and those of many that explain them best; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.rounding import REORDERED
from zeromethod.surface.far_field_laws import Known, Nodes
from zeromethod.surface.far_field_shapes import LAW, NUMBERS

_PLACES, _SIZES = (9, 7), (24.0, 12.0, 6.0, 3.0)
"""Places across and down, and the view's diagonal over sizes, of the dents that are tried."""

_NODES, _QUIET = 3, 4
"""Every so many nodes, and of the anchor, are looked at."""

_APART = 0.02
"""Least determinant of two dents' products, over that of dents which have nothing in common."""

_PARALLEL = 1e-3
"""Determinant over squared trace up to which the core's lines are parallel and have no centre."""

FREE_LAW = 0.5
"""Law that a fit starts from."""


class Tried(NamedTuple):
    """Dents 1 / (1 + z / 2) of depth 1 mm and the slopes to be explained, both over what these are off.

    about: (dents, 3) x, y, mm, and 1 / size, 1/mm. slopes: (dents, 2 n). left: (2 n,). deepest_mm: a dent.
    """

    about: Float
    slopes: Float
    left: Float
    deepest_mm: float


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def tried_dents(
    left: Float, variance: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float
) -> Tried:
    """All that are tried for slopes `left` (2, n) of a variance (2, n). limits (4, 2): of a dent."""
    places = _PLACES[0] * _PLACES[1]
    used = np.arange(0, len(nodes.x), _NODES)
    about, slopes = np.empty((len(_SIZES) * places, 3)), np.empty((len(_SIZES) * places, 2 * len(used)))
    root, explained = np.empty((2, len(used))), np.empty(2 * len(used))
    for k in range(len(used)):
        i = used[k]
        for axis in range(2):
            root[axis, k] = np.sqrt(known.weight[i] / variance[axis, i])
            explained[2 * k + axis] = root[axis, k] * left[axis, i]
    for one in range(len(about)):
        across, down = one % places % _PLACES[0], one % places // _PLACES[0]
        x = limits[0, 0] + (limits[0, 1] - limits[0, 0]) * across / (_PLACES[0] - 1)
        y = limits[1, 0] + (limits[1, 1] - limits[1, 0]) * down / (_PLACES[1] - 1)
        about[one] = x, y, _SIZES[one // places] / diagonal_mm
        z_r2, border = 0.5 * about[one, 2] ** 2, 0.0
        for i in range(0, len(known.share), _QUIET):
            away2 = (quiet.x[i] - x) ** 2 + (quiet.y[i] - y) ** 2
            border += _QUIET * known.share[i] / quiet.scale[i] / (1.0 + z_r2 * away2)
        for k in range(len(used)):
            i = used[k]
            to_x, to_y = nodes.x[i] - x, nodes.y[i] - y
            shape = 1.0 / (1.0 + z_r2 * (to_x * to_x + to_y * to_y))
            steep = -2.0 * z_r2 * shape * shape
            slopes[one, 2 * k] = root[0, k] * (steep * to_x - border * nodes.gradient_x[i])
            slopes[one, 2 * k + 1] = root[1, k] * (steep * to_y - border * nodes.gradient_y[i])
    return Tried(about, slopes, explained, limits[3, 1])


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _product(one: Float, other: Float) -> float:
    """Sum of products: in the same order on every machine's threads, which those of a library are not."""
    total = 0.0
    for k in range(len(one)):
        total += one[k] * other[k]
    return total


@numba.njit(cache=True, error_model="numpy")
def _along(tried: Tried) -> Float:
    """Products (dents,) of each dent's slopes with those to be explained."""
    return np.array([_product(one, tried.left) for one in tried.slopes])


@numba.njit(cache=True, error_model="numpy")
def best_one(tried: Tried) -> tuple[float, Float]:
    """Share of the slopes' squares that the best dent explains, and its numbers (7,); depth 0 for none."""
    along, best, out = _along(tried), 0.0, np.zeros(NUMBERS)
    for one in range(len(along)):
        square = _product(tried.slopes[one], tried.slopes[one])
        depth_mm = along[one] / square
        if along[one] * depth_mm > best and abs(depth_mm) < tried.deepest_mm:
            best = along[one] * depth_mm
            _fill(out, depth_mm, tried.about[one])
    return best / max(_product(tried.left, tried.left), 1e-300), out


@numba.njit(cache=True, error_model="numpy")
def best_two(tried: Tried) -> Float:
    """Numbers (14,) of the two dents that together explain the slopes best."""
    along = _along(tried)
    squares = np.array([_product(one, one) for one in tried.slopes])
    best, out = 0.0, np.zeros(2 * NUMBERS)
    for one in range(len(along)):
        for other in range(one):
            a, b, c = squares[one], _product(tried.slopes[one], tried.slopes[other]), squares[other]
            determinant = a * c - b * b
            if determinant > _APART * a * c:
                first = (c * along[one] - b * along[other]) / determinant
                second = (a * along[other] - b * along[one]) / determinant
                gain = first * along[one] + second * along[other]
                if gain > best and max(abs(first), abs(second)) < tried.deepest_mm:
                    best = gain
                    _fill(out[:NUMBERS], first, tried.about[one])
                    _fill(out[NUMBERS:], second, tried.about[other])
    return out


@numba.njit(cache=True, error_model="numpy")
def _fill(numbers: Float, depth_mm: float, about: Float) -> None:
    """Fill in the numbers (7,) of a round dent."""
    numbers[0], numbers[1], numbers[2] = depth_mm, about[0], about[1]
    numbers[3], numbers[4], numbers[5], numbers[LAW] = about[2], 0.0, about[2], FREE_LAW


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def centre(nodes: Nodes, constant: float, core_mm: float) -> tuple[float, float]:
    """Point that the core's lines of steepest descent pass closest to; NaN for parallel ones.

    The core is deeper than core_mm. Minimises sum |s x (p - c)|^2, which also works for a dent that is cut
    off by the view or has a hole.
    """
    a = b = c = u = v = 0.0
    for i in range(len(nodes.x)):
        used = 1.0 if abs(nodes.depth[i] - constant * nodes.scale[i]) > core_mm else 0.0
        sx = used * (nodes.slope_x[i] - constant * nodes.gradient_x[i])
        sy = used * (nodes.slope_y[i] - constant * nodes.gradient_y[i])
        cross = sx * nodes.y[i] - sy * nodes.x[i]
        a += sy * sy
        b += sx * sy
        c += sx * sx
        u -= sy * cross
        v += sx * cross
    determinant = a * c - b * b
    if not determinant > _PARALLEL * (a + c) ** 2:
        return np.nan, np.nan
    return (c * u + b * v) / determinant, (b * u + a * v) / determinant
