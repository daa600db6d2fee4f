"""How well each dent that a multiple C of the scale implies obeys the laws of `far_field`; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float

_CORE_SHARE = 0.2
"""Depth over the largest at which the dent's core, which gives its centre, ends."""

_PARALLEL = 1e-3
"""Determinant over squared trace up to which the core's lines are parallel and have no centre."""

_WRONG, _FLAT = 0.03, 0.01
"""Error of the law's slope at each node by which fits are weighted, over r . s and over depth."""

_WRONGS = (0.001, 0.004, 0.016, 0.064, 0.256)
"""Errors over r . s of which one explains, with the noise, what a law leaves."""

_NO_CENTRE = 50.0
"""Logarithm of misfit of a C that leaves no centre."""

_OUTWARDS = 0.02
"""Share of the squares of slopes that lead deeper outwards, as no decay does, that the long law misses."""

_SIZES_ROUND = (0.0, 1.0, 1.414, 2.0, 2.828, 4.0, 5.657, 8.0, 11.31, 16.0, 22.63, 32.0, 45.25)
_SIZES_ROOT = (1.0, 2.0, 4.0, 8.0, 16.0)
_SIZES_LONG = (0.0, 2.0, 4.0, 8.0, 16.0)
"""The view's diagonal over the size of dent, sqrt(1 / g), of each member of the laws."""

ROUND = len(_SIZES_ROUND) + len(_SIZES_ROOT)
MEMBERS = ROUND + len(_SIZES_LONG)
"""Members of the round law, and of both."""

_NEAREST_MM2 = 1e-3
"""Least square of a node's distance from the centre."""

_RIDGE = 1e-10
"""Added to the products of terms, over their own squares: two terms may be the same on these nodes."""

_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Of x and y in the long law's polynomial."""

_SUMS = {"contract", "reassoc"}
"""Sums over nodes may be taken in any order, which changes rounding alone, so that they are vectorised."""


class Nodes(NamedTuple):
    """Some nodes, each (n,): slope, its variance, scale's gradient, 1/mm; depth, mm, scale, place, mm."""

    slope_x: Float
    slope_y: Float
    variance_x: Float
    variance_y: Float
    gradient_x: Float
    gradient_y: Float
    depth: Float
    scale: Float
    x: Float
    y: Float


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def unlikely(nodes: Nodes, constant: float, diagonal_mm: float, row: Float) -> tuple[float, float]:
    """Fill in a row (2 + `MEMBERS`,) for one C; return the centre, mm.

    Least misfit of the laws, in mean weighted squares, and that of noise alone; then, for each member, how
    unlikely it makes the slopes: -2 log of their density, a node's. First come the round law's.
    """
    n = len(nodes.x)
    deepest = middle_x = middle_y = 0.0
    for i in range(n):
        deepest = max(deepest, abs(nodes.depth[i] - constant * nodes.scale[i]))
        middle_x += nodes.x[i] / n
        middle_y += nodes.y[i] / n
    x_mm, y_mm = centre(nodes, constant, _CORE_SHARE * deepest)
    if np.isnan(x_mm):
        row[0], row[1], row[2:] = np.exp(_NO_CENTRE), 1.0, _NO_CENTRE
        return middle_x, middle_y
    x, y, away2 = np.empty(n), np.empty(n), np.empty(n)
    depth2, mixed, noise2, radials2 = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    noise = deeper2 = radial2 = 0.0
    for i in range(n):
        x[i], y[i] = nodes.x[i] - x_mm, nodes.y[i] - y_mm
        away2[i] = x[i] * x[i] + y[i] * y[i]
        depth = nodes.depth[i] - constant * nodes.scale[i]
        slope_x = nodes.slope_x[i] - constant * nodes.gradient_x[i]
        slope_y = nodes.slope_y[i] - constant * nodes.gradient_y[i]
        radial = x[i] * slope_x + y[i] * slope_y
        noise2[i] = nodes.variance_x[i] * (x[i] * x[i]) + nodes.variance_y[i] * (y[i] * y[i])
        radials2[i] = radial * radial
        # the core follows laws of its own
        core = (1.02 - abs(depth) / deepest) ** 2
        weight = core / (noise2[i] + (_WRONG * radial) ** 2 + (_FLAT * depth) ** 2)
        noise += weight * noise2[i]
        weighed2 = weight * radial * radial
        deeper2 += weighed2 if radial * depth > 0.0 else 0.0
        radial2 += weighed2
        depth2[i], mixed[i] = weight * depth * depth, weight * depth * radial
    row[1] = noise / n
    expected, level = _levels(noise2, radials2, away2, noise / n, radial2 / n)
    flatter = np.empty(n)
    for k in range(ROUND):
        rooted = k >= len(_SIZES_ROUND)
        size = _SIZES_ROOT[k - len(_SIZES_ROUND)] if rooted else _SIZES_ROUND[k]
        g = (size / diagonal_mm) ** 2
        for i in range(n):
            flatter[i] = 1.0 / (1.0 + g * away2[i])
        if rooted:
            for i in range(n):
                flatter[i] = np.sqrt(flatter[i])
        row[2 + k] = _left_by_round(depth2, mixed, away2, radial2, flatter) / n
    for k, size in enumerate(_SIZES_LONG):
        left2 = _left_by_long(depth2, mixed, x, y, away2, radial2, (size / diagonal_mm) ** 2)
        row[2 + ROUND + k] = max(left2, _OUTWARDS * deeper2) / n
    row[0] = row[2:].min()
    for k in range(2, len(row)):
        row[k] = _by_misfit(row[k], expected, level)
    return x_mm, y_mm


@numba.njit(cache=True, error_model="numpy")
def _levels(noise2: Float, radial2: Float, away2: Float, noise: float, radial: float) -> tuple[Float, Float]:
    """For each of `_WRONGS`: the misfit to expect, and mean log of the slopes' variance along the radius.

    noise, radial: mean weighted squares of both. Every second node is enough, and products spare logarithms.
    """
    expected, level = np.empty(len(_WRONGS)), np.empty(len(_WRONGS))
    for k, wrong in enumerate(_WRONGS):
        expected[k] = noise + wrong * wrong * radial
        total, product, count = 0.0, 1.0, 0
        for i in range(0, len(noise2), 2):
            product *= (noise2[i] + wrong * wrong * radial2[i]) / (away2[i] + _NEAREST_MM2)
            count += 1
            if not 1e-200 < product < 1e100:
                total += np.log(product)
                product = 1.0
        level[k] = (total + np.log(product)) / count
    return expected, level


@numba.njit(cache=True, error_model="numpy")
def _by_misfit(misfit: float, expected: Float, level: Float) -> float:
    """-2 log of the density of slopes, a node's, at the error that explains a misfit best."""
    last = len(expected) - 1
    if misfit <= expected[0]:
        return float(level[0] + misfit / expected[0])
    if misfit >= expected[last]:
        return float(level[last] + 1.0 + np.log(misfit / expected[last]))
    k = 1
    while misfit > expected[k]:
        k += 1
    share = np.log(misfit / expected[k - 1]) / np.log(expected[k] / expected[k - 1])
    return float(level[k - 1] + share * (level[k] - level[k - 1]) + 1.0)


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
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


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _left_by_round(depth2: Float, mixed: Float, away2: Float, radial2: float, flatter: Float) -> float:
    """Squares that (n + k r^2) times `flatter` leaves of r . s, by depth^2, depth r . s, and (r . s)^2."""
    one = two = three = a = b = 0.0
    for i in range(len(away2)):
        square, cross, away = depth2[i] * flatter[i] * flatter[i], mixed[i] * flatter[i], away2[i]
        one += square
        two += square * away
        three += square * away * away
        a += cross
        b += cross * away
    # n, k >= 0: both, one of them, or none
    left, determinant = radial2, one * three - two * two
    if a < 0.0:
        left = min(left, radial2 - a * a / one)
    if b < 0.0:
        left = min(left, radial2 - b * b / three)
    n, k = b * two - a * three, a * two - b * one
    if n >= 0.0 and k >= 0.0 and determinant > _RIDGE * one * three:
        left = min(left, radial2 + (n * a + k * b) / determinant)
    return float(max(left, 0.0))


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _left_by_long(
    depth2: Float, mixed: Float, x: Float, y: Float, away2: Float, radial2: float, g: float
) -> float:
    """The same of a polynomial of second degree in x and y (m,), from the centre, over 1 + g r^2."""
    square, cross = np.empty(len(x)), np.empty(len(x))
    for i in range(len(x)):
        flatter = 1.0 / (1.0 + g * away2[i])
        square[i], cross[i] = depth2[i] * flatter * flatter, mixed[i] * flatter
    among, across = _moments(square, x, y), _few_moments(cross, x, y)
    gram = np.empty((7, 7))
    for i, (a, b) in enumerate(_POWERS):
        for j, (c, d) in enumerate(_POWERS):
            gram[i, j] = among[a + c, b + d]
        gram[i, 6] = gram[6, i] = across[i]
    gram[6, 6] = radial2
    return _left(gram)


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _moments(weight: Float, x_mm: Float, y_mm: Float) -> Float:
    """Sums (5, 5) of weight x^a y^b, a + b up to 4."""
    one = a = b = aa = ab = bb = aaa = aab = abb = bbb = aaaa = aaab = aabb = abbb = bbbb = 0.0
    for i in range(len(weight)):
        x, y, w = x_mm[i], y_mm[i], weight[i]
        wx, wy = w * x, w * y
        wxx, wxy, wyy = wx * x, wx * y, wy * y
        wxxx, wxxy, wxyy, wyyy = wxx * x, wxx * y, wyy * x, wyy * y
        one += w
        a += wx
        b += wy
        aa += wxx
        ab += wxy
        bb += wyy
        aaa += wxxx
        aab += wxxy
        abb += wxyy
        bbb += wyyy
        aaaa += wxxx * x
        aaab += wxxx * y
        aabb += wxxy * y
        abbb += wyyy * x
        bbbb += wyyy * y
    found = np.zeros((5, 5))
    found[0, 0], found[0, 1], found[0, 2], found[0, 3], found[0, 4] = one, b, bb, bbb, bbbb
    found[1, 0], found[1, 1], found[1, 2], found[1, 3] = a, ab, abb, abbb
    found[2, 0], found[2, 1], found[2, 2] = aa, aab, aabb
    found[3, 0], found[3, 1], found[4, 0] = aaa, aaab, aaaa
    return found


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _few_moments(weight: Float, x: Float, y: Float) -> tuple[float, float, float, float, float, float]:
    """Sums of weight times `_POWERS`."""
    one = a = b = aa = ab = bb = 0.0
    for i in range(len(weight)):
        w = weight[i]
        one += w
        a += w * x[i]
        b += w * y[i]
        aa += w * x[i] * x[i]
        ab += w * x[i] * y[i]
        bb += w * y[i] * y[i]
    return one, a, b, aa, ab, bb


@numba.njit(cache=True, error_model="numpy")
def _left(gram: Float) -> float:
    """Least squares of the last term plus a sum of the others, by the products (p, p) of them all."""
    count = len(gram)
    scaled, size = np.empty_like(gram), np.empty(count)
    for i in range(count):
        size[i] = np.sqrt(max(gram[i, i], 1e-300))
        for j in range(i + 1):
            scaled[i, j] = scaled[j, i] = gram[i, j] / (size[i] * size[j])
        scaled[i, i] += _RIDGE if i < count - 1 else 0.0
    for k in range(count - 1):
        for i in range(k + 1, count):
            factor = scaled[i, k] / scaled[k, k]
            for j in range(k + 1, count):
                scaled[i, j] -= factor * scaled[k, j]
    return float(max(scaled[-1, -1], 0.0) * size[-1] ** 2)
