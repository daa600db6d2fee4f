"""What dents fitted by each law of `far_field` say together of the multiple C of the scale; compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.far_field_fit import (
    COLUMNS,
    CONSTANT,
    COUNT,
    EXCESS,
    NOISE,
    SHORT,
    SPREAD,
    UNLIKELY,
    VARIANCE,
    WRONG,
    fit,
    pieces,
)
from zeromethod.surface.far_field_laws import LAYER, NUMBERS, Known, Nodes, equations

_UNFIT = 0.15
"""Error of a law from which a fit may have ended in a wrong place."""

_SURE, _FAR, _CLOSE, _LAYERS = 0.03, 6.0, 0.02, (0.1, 0.6)
"""Error of a law up to which others are left out that are so many standard deviations, and more, from the one
fitted; the laws that a layer's dent is taken for."""

_EXPLAINED = 2.5
"""Logarithm of likelihood by which a law is wrong from which a second dent is tried."""

_PASSES = 24
"""Most passes of a fit."""

_PLACES, _SIZES = (9, 7), (24.0, 12.0, 6.0, 3.0)
"""Places and sizes, the view's diagonal over it, of dents that are tried to start from."""

_BEYOND, _LARGEST, _SMALLEST, _DEEPEST = 0.45, 1.5, 0.005, 10.0
"""Limits of a dent: way beyond the view and sizes over its diagonal, depth over range."""

_RANGES = 1.0
"""Standard deviation of the anchor's depth over the range read, before anything is read."""

_MEMBERS = 11
"""Four of one dent, as many from another start, and three of two."""


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _placed(
    left: Float, variance: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float
) -> Float:
    """Numbers (6,) of the round dent 1 / (1 + z / 2) that explains best what is left of the slopes (2, n)."""
    best, found = 0.0, np.zeros(NUMBERS)
    for size in _SIZES:
        z_r2 = 0.5 * (size / diagonal_mm) ** 2
        for place in range(_PLACES[0] * _PLACES[1]):
            x = limits[0, 0] + (limits[0, 1] - limits[0, 0]) * (place % _PLACES[0]) / (_PLACES[0] - 1)
            y = limits[1, 0] + (limits[1, 1] - limits[1, 0]) * (place // _PLACES[0]) / (_PLACES[1] - 1)
            border = across = square = 0.0
            for i in range(0, len(known.share), 4):
                away2 = (quiet.x[i] - x) ** 2 + (quiet.y[i] - y) ** 2
                border += 4.0 * known.share[i] / quiet.scale[i] / (1.0 + z_r2 * away2)
            for i in range(0, len(nodes.x), 3):
                along, down = nodes.x[i] - x, nodes.y[i] - y
                shape = 1.0 / (1.0 + z_r2 * (along * along + down * down))
                slope_x = -2.0 * z_r2 * shape * shape * along - border * nodes.gradient_x[i]
                slope_y = -2.0 * z_r2 * shape * shape * down - border * nodes.gradient_y[i]
                weight_x = known.weight[i] / variance[0, i]
                weight_y = known.weight[i] / variance[1, i]
                across += weight_x * slope_x * left[0, i] + weight_y * slope_y * left[1, i]
                square += weight_x * slope_x * slope_x + weight_y * slope_y * slope_y
            if across * across > best * square and abs(across) < limits[3, 1] * square:
                best, a = across * across / square, size / diagonal_mm
                found[:] = across / square, x, y, a, 0.0, a
    return found


@numba.njit(cache=True, error_model="numpy")
def posterior(
    nodes: Nodes, quiet: Nodes, known: Known, start: Float, range_mm: float, diagonal_mm: float
) -> tuple[float, float]:
    """Mean and standard deviation of C, mm.

    start: numbers (6,) of a dent to start from. range_mm: of depth read; diagonal_mm: of the view.
    """
    limits, members = _limits(nodes, range_mm, diagonal_mm), np.full((_MEMBERS, COLUMNS), np.inf)
    one, best = np.append(start, 0.5), 0
    alone = np.append(start, 0.5)
    for turn in range(2):
        first = 4 * turn
        fit(one, True, _PASSES, nodes, quiet, known, limits, members[best, UNLIKELY], members[first])
        best = first if turn == 0 or members[first, UNLIKELY] < members[best, UNLIKELY] else best
        if best == first:
            alone[:] = one
        for k, law in ((1, 1.0), (2, 0.0), (3, LAYER)):
            if turn == 0 and not _possible(members[0], one[-1], law):
                continue
            same = _same_scale(alone if members[best, WRONG] < _UNFIT else one, law)
            fit(
                same,
                False,
                _PASSES,
                nodes,
                quiet,
                known,
                limits,
                members[best, UNLIKELY],
                members[first + k],
            )
            if members[first + k, UNLIKELY] < members[best, UNLIKELY]:
                best, alone[:] = first + k, same
        if members[best, WRONG] < _UNFIT:
            break
        one[:-1] = _placed_alone(nodes, quiet, known, limits, diagonal_mm)
        one[-1] = 0.5
    if members[best, EXCESS] > _EXPLAINED:
        found = equations(
            alone, nodes, quiet, known, max(members[best, WRONG] ** 2, 1e-4), np.ones((2, len(nodes.x)))
        )
        beside = _placed(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)
        _fit_two(
            alone, beside, nodes, quiet, known, limits, diagonal_mm, members[best, UNLIKELY], members[8:]
        )
    return _together(members, known.rest_mm, _RANGES * range_mm)


@numba.njit(cache=True, error_model="numpy")
def _possible(member: Float, found: float, law: float) -> bool:
    """Whether a law may be the right one where the one fitted is `found`."""
    if not member[WRONG] < _SURE:
        return True
    low, high = (_LAYERS[0], _LAYERS[1]) if law == LAYER else (law, law)
    spread = _FAR * member[SPREAD] + _CLOSE
    return bool(low - spread < found < high + spread)


@numba.njit(cache=True, error_model="numpy")
def _same_scale(numbers: Float, law: float) -> Float:
    """The same dents with another law."""
    out = numbers.copy()
    out[-1] = law
    return out


@numba.njit(cache=True, error_model="numpy")
def _limits(nodes: Nodes, range_mm: float, diagonal_mm: float) -> Float:
    """Limits (4, 2) of a dent."""
    beyond = _BEYOND * diagonal_mm
    return np.array(
        [
            [nodes.x.min() - beyond, nodes.x.max() + beyond],
            [nodes.y.min() - beyond, nodes.y.max() + beyond],
            [_SMALLEST * diagonal_mm, _LARGEST * diagonal_mm],
            [-_DEEPEST * range_mm, _DEEPEST * range_mm],
        ]
    )


@numba.njit(cache=True, error_model="numpy")
def _fit_two(
    alone: Float,
    beside: Float,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    limits: Float,
    diagonal_mm: float,
    best: float,
    members: Float,
) -> None:
    """Fit two dents of one law: the one found alone and one beside it, or a wide bulge around it."""
    law = np.full(1, alone[-1] if alone[-1] >= 0.0 else 0.3)
    two = np.concatenate((alone[:-1], beside, law))
    around = np.concatenate((alone[:-1], alone[:-1], law))
    around[0], around[NUMBERS] = 1.15 * alone[0], -0.15 * alone[0]
    around[NUMBERS + 3 : 2 * NUMBERS] *= 0.5
    fit(two, True, SHORT, nodes, quiet, known, limits, best, members[0])
    fit(around, True, SHORT, nodes, quiet, known, limits, best, members[1])
    if members[1, UNLIKELY] < members[0, UNLIKELY]:
        two[:] = around
        members[0] = members[1]
    if members[0, WRONG] > _UNFIT:
        first = _placed_alone(nodes, quiet, known, limits, diagonal_mm)
        found = equations(np.append(first, 0.5), nodes, quiet, known, 1e-2, np.ones((2, len(nodes.x))))
        second = _placed(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)
        around[:] = np.concatenate((first, second, np.full(1, 0.5)))
        fit(around, True, 2 * SHORT, nodes, quiet, known, limits, best, members[1])
        if members[1, UNLIKELY] < members[0, UNLIKELY]:
            two[:] = around
    fit(two, True, _PASSES, nodes, quiet, known, limits, best, members[0])
    for k, of_law in ((1, 1.0), (2, 0.0)):
        members[k, UNLIKELY] = np.inf
        if _possible(members[0], two[-1], of_law):
            same = _same_scale(two, of_law)
            fit(same, False, _PASSES, nodes, quiet, known, limits, best, members[k])


@numba.njit(cache=True, error_model="numpy")
def _placed_alone(nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float) -> Float:
    """Numbers (6,) of the round dent that explains the slopes best."""
    none = np.array([0.0, nodes.x[0], nodes.y[0], 1.0 / diagonal_mm, 0.0, 1.0 / diagonal_mm, 0.5])
    found = equations(none, nodes, quiet, known, 1e-2, np.ones((2, len(nodes.x))))
    return _placed(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)


@numba.njit(cache=True, error_model="numpy")
def _together(members: Float, rest_mm: float, about_mm: float) -> tuple[float, float]:
    """Mean and standard deviation of C by all members, each as likely as it makes the slopes."""
    best = np.argmin(members[:, UNLIKELY])
    independent = pieces(members[best, NOISE])
    likely = -independent * members[:, UNLIKELY] - 0.5 * np.log(independent) * members[:, COUNT]
    likely = np.exp(likely - likely.max())
    likely /= likely.sum()
    # none is known better than that the anchor is about as deep as what is read
    kept = 1.0 / (1.0 + members[:, VARIANCE] / about_mm**2)
    mean = variance = 0.0
    for k in range(len(members)):
        if likely[k] > 0.0:
            mean += likely[k] * (rest_mm + kept[k] * (members[k, CONSTANT] - rest_mm))
    for k in range(len(members)):
        if likely[k] > 0.0:
            off = rest_mm + kept[k] * (members[k, CONSTANT] - rest_mm) - mean
            own = about_mm**2 if members[k, VARIANCE] == np.inf else kept[k] * members[k, VARIANCE]
            variance += likely[k] * (own + off * off)
    return mean, np.sqrt(variance)
