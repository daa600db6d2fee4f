"""Dents by the laws of `far_field`, and how well they explain what was read: sums over nodes, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Ints
from zeromethod.rounding import REORDERED
from zeromethod.surface.far_field_shapes import (
    BALL,
    FAR_OF_BALL,
    GAUSSIAN,
    LAW,
    NUMBERS,
    POINT,
    dents_end,
    of_ball,
    share_of_body,
)

SET_LAWS, ONE_LAW, OWN_LAWS = range(3)
"""Laws of several dents: as they are, one that is fitted, the first one's, or fitted to each."""

_FLAT = 0.1
"""Weight of (depth / distance)^2 against slope^2 in what a law's error is relative to."""


class Nodes(NamedTuple):
    """Some nodes, each (n,): slope, its variance, scale's gradient, 1/mm; depth, mm, scale, place, mm.

    products: (3, products, n) of the body there, 1/mm, and their slopes.
    """

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
    products: Float


@numba.njit(cache=True, error_model="numpy")
def chosen(
    lattice: tuple[Float, Float, Float, Float, Float, Float, Float],
    products: Float,
    rows: Ints,
    columns: Ints,
) -> Nodes:
    """Nodes of these rows and columns (n,).

    lattice: slope, variance, gradient, depth, scale, x and y. products: (3, products, rows, columns).
    """
    slope, variance, gradient, depth, scale, x, y = lattice
    out = np.empty((10, len(rows)))
    for k in range(len(rows)):
        i, j = rows[k], columns[k]
        for axis in range(2):
            out[axis, k], out[2 + axis, k] = slope[i, j, axis], variance[i, j, axis]
            out[4 + axis, k] = gradient[i, j, axis]
        out[6, k], out[7, k], out[8, k], out[9, k] = depth[i, j], scale[i, j], x[i, j], y[i, j]
    by_body = np.empty((3, products.shape[1], len(rows)))
    for part in range(3):
        for one in range(products.shape[1]):
            for k in range(len(rows)):
                by_body[part, one, k] = products[part, one, rows[k], columns[k]]
    return Nodes(out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7], out[8], out[9], by_body)


class Body(NamedTuple):
    """How a load's dent in the body depends on the load's place: series of `mechanics.body.BodyKernel`.

    of_loads: (products, y, x) coefficients, none where the body is not known. box_mm: (2, 2) from and to, of
    x and of y. most_law: of a dent.
    """

    of_loads: Float
    box_mm: Float
    most_law: float


class Known(NamedTuple):
    """What is known of nodes and of quiet ones of the anchor.

    weight: (n,), of the nodes, less in the core. share: (q,), weights of the quiet ones, which add up to 1;
    rest_mm: mean depth / h with these. body: how it answers loads.
    """

    weight: Float
    share: Float
    rest_mm: float
    body: Body


class Equations(NamedTuple):
    """Linear equations for steps of the numbers (p,) of some dents, and how well these explain the slopes.

    normal (p, p), right (p,): of the weighted squares. border_mm: depth / h that the dents leave at the
    anchor, and its derivatives of_border (p,). left, variance: (2, n) slopes that are left and what is
    expected of them. misfit: weighted squares left over that variance, and `before`, over the one before.
    growth: what the square of the law's error lacks to explain them best.
    """

    normal: Float
    right: Float
    border_mm: float
    of_border: Float
    left: Float
    variance: Float
    misfit: float
    before: float
    growth: float


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _add(dent: Float, x: Float, y: Float, by: Float, field: Float) -> None:
    """Add one dent's depth and slopes to `field` (3, n); fill in its derivatives `by` (7, 3, n)."""
    depth, a, b, c, law = dent[0], dent[3], dent[4], dent[5], dent[LAW]
    k = min(law, POINT) if law > GAUSSIAN else 0.0
    # the shape, its derivatives by z and that of its logarithm by the law, apart from what is vectorised
    for i in range(len(x)):
        u, v = a * (x[i] - dent[1]) + b * (y[i] - dent[2]), c * (y[i] - dent[2])
        z = u * u + v * v
        of_law = 0.0
        if law >= BALL:
            shape, first, second = of_ball(z)
        elif law < 0.0:
            flatter = 1.0 / np.sqrt(1.0 + z)
            shape = np.exp(1.0 - np.sqrt(1.0 + z))
            first, second = -0.5 * shape * flatter, 0.25 * shape * flatter * flatter * (1.0 + flatter)
        else:
            flatter = 1.0 / (1.0 + k * z)
            fall = 0.5 * np.log(1.0 + k * z) / k if k > 0.0 else 0.5 * z
            of_law = (fall - 0.5 * z * flatter) / k if k > 0.0 else 0.25 * z * z
            shape = np.exp(-fall)
            first, second = -0.5 * shape * flatter, 0.25 * shape * flatter * flatter * (1.0 + 2.0 * k)
        by[0, 0, i], by[3, 0, i], by[4, 0, i], by[5, 0, i] = shape, of_law, first, second
    own_law = law < BALL and law >= 0.0
    for i in range(len(x)):
        across, down = x[i] - dent[1], y[i] - dent[2]
        u, v = a * across + b * down, c * down
        shape, of_law, first, second = by[0, 0, i], by[3, 0, i], by[4, 0, i], by[5, 0, i]
        z_x, z_y = 2.0 * u * a, 2.0 * (u * b + v * c)
        by[0, 1, i], by[0, 2, i] = first * z_x, first * z_y
        first, second = depth * first, depth * second
        slope_x, slope_y = first * z_x, first * z_y
        if own_law:
            z_flatter = (u * u + v * v) / (1.0 + k * (u * u + v * v))
            by[LAW, 0, i] = depth * shape * of_law
            by[LAW, 1, i] = slope_x * (of_law - z_flatter)
            by[LAW, 2, i] = slope_y * (of_law - z_flatter)
        by[1, 0, i], by[2, 0, i] = -slope_x, -slope_y
        z_a, z_b, z_c = 2.0 * u * across, 2.0 * u * down, 2.0 * v * down
        by[3, 0, i], by[4, 0, i], by[5, 0, i] = first * z_a, first * z_b, first * z_c
        by[1, 1, i] = -second * z_x * z_x - 2.0 * first * a * a
        by[1, 2, i] = by[2, 1, i] = -second * z_x * z_y - 2.0 * first * a * b
        by[2, 2, i] = -second * z_y * z_y - 2.0 * first * (b * b + c * c)
        by[3, 1, i] = second * z_x * z_a + 2.0 * first * (u + a * across)
        by[3, 2, i] = second * z_y * z_a + 2.0 * first * b * across
        by[4, 1, i] = second * z_x * z_b + 2.0 * first * a * down
        by[4, 2, i] = second * z_y * z_b + 2.0 * first * (u + b * down)
        by[5, 1, i] = second * z_x * z_c
        by[5, 2, i] = second * z_y * z_c + 4.0 * first * v
        field[0, i] += depth * shape
        field[1, i] += slope_x
        field[2, i] += slope_y


@numba.njit(cache=True, error_model="numpy")
def _waves(at: float, low: float, high: float, count: int) -> Float:
    """(2, count) Chebyshev polynomials and their derivatives at a place; beyond the ends as there."""
    t = min(max((2.0 * at - low - high) / (high - low), -1.0), 1.0)
    by = 2.0 / (high - low) if low < at < high else 0.0
    out = np.zeros((2, count))
    out[0, 0] = 1.0
    if count > 1:
        out[0, 1], out[1, 1] = t, 1.0
    for k in range(2, count):
        out[0, k] = 2.0 * t * out[0, k - 1] - out[0, k - 2]
        out[1, k] = 2.0 * out[0, k - 1] + 2.0 * t * out[1, k - 1] - out[1, k - 2]
    out[1] *= by
    return out


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _add_body(dent: Float, body: Body, products: Float, by: Float, field: Float) -> None:
    """Add what the body adds to a load at the dent's place to `field` (3, n), and to its derivatives `by`."""
    depth, a, c, share = dent[0], dent[3], dent[5], share_of_body(dent[LAW])
    count, down, across = body.of_loads.shape
    x = _waves(dent[1], body.box_mm[0, 0], body.box_mm[0, 1], across)
    y = _waves(dent[2], body.box_mm[1, 0], body.box_mm[1, 1], down)
    by_load = np.zeros((3, count))
    for one in range(count):
        for i in range(down):
            value = slope = 0.0
            for j in range(across):
                value += body.of_loads[one, i, j] * x[0, j]
                slope += body.of_loads[one, i, j] * x[1, j]
            by_load[0, one] += y[0, i] * value
            by_load[1, one] += y[0, i] * slope
            by_load[2, one] += y[1, i] * value
    # (1 + z)^(-1/2) is size / r far away
    size = (FAR_OF_BALL if dent[LAW] >= BALL else 1.0) / np.sqrt(a * c)
    by_load *= size
    added = np.zeros((3, products.shape[2]))
    for part in range(3):
        added[:] = 0.0
        # four at a time, as memory is slower than sums
        for one in range(0, count - 3, 4):
            of, to = by_load[:, one : one + 4], products[part, one : one + 4]
            for kind in range(3):
                for i in range(added.shape[1]):
                    by_four = of[kind, 0] * to[0, i] + of[kind, 1] * to[1, i]
                    added[kind, i] += by_four + (of[kind, 2] * to[2, i] + of[kind, 3] * to[3, i])
        for one in range(count // 4 * 4, count):
            for kind in range(3):
                for i in range(added.shape[1]):
                    added[kind, i] += by_load[kind, one] * products[part, one, i]
        for i in range(added.shape[1]):
            whole = added[0, i]
            field[part, i] += depth * share * whole
            by[0, part, i] += share * whole
            by[1, part, i] += depth * share * added[1, i]
            by[2, part, i] += depth * share * added[2, i]
            by[3, part, i] -= 0.5 * depth * share * whole / a
            by[5, part, i] -= 0.5 * depth * share * whole / c
            by[LAW, part, i] = depth * whole


@numba.njit(cache=True, error_model="numpy")
def added_by_body(numbers: Float, quiet: Nodes, known: Known) -> float:
    """Depth / h at the anchor, mm, that the body adds to loads."""
    field, by = np.zeros((3, len(quiet.x))), np.zeros((NUMBERS, 3, len(quiet.x)))
    for k in range(0, dents_end(numbers), NUMBERS):
        if share_of_body(numbers[k + LAW]) > 0.0:
            _add_body(numbers[k : k + NUMBERS], known.body, quiet.products, by, field)
    total = 0.0
    for i in range(len(known.share)):
        total += known.share[i] / quiet.scale[i] * field[0, i]
    return total


@numba.njit(cache=True, error_model="numpy")
def _dents(numbers: Float, laws: int, nodes: Nodes, body: Body) -> tuple[Float, Float]:
    """Depth and slopes (3, n) of all dents, a tilt's slopes, and their derivatives (p, 3, n)."""
    end, count = dents_end(numbers), len(nodes.x)
    field, by = np.zeros((3, count)), np.zeros((len(numbers), 3, count))
    for axis in range(len(numbers) - end):
        field[1 + axis], by[end + axis, 1 + axis] = numbers[end + axis], 1.0
    for k in range(0, end, NUMBERS):
        _add(numbers[k : k + NUMBERS], nodes.x, nodes.y, by[k : k + NUMBERS], field)
        if share_of_body(numbers[k + LAW]) > 0.0:
            _add_body(numbers[k : k + NUMBERS], body, nodes.products, by[k : k + NUMBERS], field)
        if k > 0 and laws == ONE_LAW:
            by[LAW] += by[k + LAW]
            by[k + LAW] = 0.0
    return field, by


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def nearest2(numbers: Float, x: Float, y: Float) -> Float:
    """Squared distance (n,) of places from the next dent, mm^2, at least about that dent's size."""
    near2 = np.full(len(x), np.inf)
    for k in range(0, dents_end(numbers), NUMBERS):
        size2 = 1.0 / (numbers[k + 3] * numbers[k + 5])
        for i in range(len(x)):
            across, down = x[i] - numbers[k + 1], y[i] - numbers[k + 2]
            near2[i] = min(near2[i], across * across + down * down + size2)
    return near2


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def equations(
    numbers: Float, laws: int, nodes: Nodes, quiet: Nodes, known: Known, wrong2: float, before: Float
) -> Equations:
    """Of dents with these numbers (p,), whose laws are wrong by wrong2, relative, squared.

    before: (2, n) variance of slopes that `Equations.before` is relative to.
    """
    count, n = len(numbers), len(nodes.x)
    field, by = _dents(numbers, laws, quiet, known.body)
    border_mm, of_border = 0.0, np.zeros(count)
    for i in range(len(known.share)):
        border_mm += known.share[i] / quiet.scale[i] * field[0, i]
        for j in range(count):
            of_border[j] += known.share[i] / quiet.scale[i] * by[j, 0, i]
    constant = known.rest_mm - border_mm
    field, by = _dents(numbers, laws, nodes, known.body)
    near2 = nearest2(numbers, nodes.x, nodes.y)
    left, variance, weight = np.empty((2, n)), np.empty((2, n)), np.empty((2, n))
    misfit = misfit_before = lacking = expected = 0.0
    for i in range(n):
        slope_x = nodes.slope_x[i] - constant * nodes.gradient_x[i]
        slope_y = nodes.slope_y[i] - constant * nodes.gradient_y[i]
        depth = nodes.depth[i] - constant * nodes.scale[i]
        of_law = slope_x * slope_x + slope_y * slope_y + _FLAT * depth * depth / near2[i]
        left[0, i], left[1, i] = slope_x - field[1, i], slope_y - field[2, i]
        variance[0, i] = nodes.variance_x[i] + wrong2 * of_law
        variance[1, i] = nodes.variance_y[i] + wrong2 * of_law
        for axis in range(2):
            left2 = left[axis, i] * left[axis, i]
            weight[axis, i] = known.weight[i] / variance[axis, i]
            misfit_before += known.weight[i] * left2 / before[axis, i]
            misfit += weight[axis, i] * left2
            share = of_law / variance[axis, i]
            lacking += known.weight[i] * share * (left2 / variance[axis, i] - 1.0)
            expected += known.weight[i] * share * share
    normal, right = np.empty((count, count)), np.empty(count)
    for j in range(count):
        one = by[j]
        for i in range(n):
            one[1, i] -= of_border[j] * nodes.gradient_x[i]
            one[2, i] -= of_border[j] * nodes.gradient_y[i]
            # its depth is not needed any more
            one[0, i] = one[1, i] * weight[0, i]
        total = 0.0
        for i in range(n):
            total += one[0, i] * left[0, i] + weight[1, i] * one[2, i] * left[1, i]
        right[j] = total
        for k in range(j + 1):
            other = by[k]
            total = 0.0
            for i in range(n):
                total += one[0, i] * other[1, i] + one[2, i] * weight[1, i] * other[2, i]
            normal[j, k] = normal[k, j] = total
    growth = lacking / max(expected, 1e-300)
    return Equations(normal, right, border_mm, of_border, left, variance, misfit, misfit_before, growth)
