"""Several dents fitted to slopes, of one law or of their own: members of `far_field_posterior`; compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.far_field_fit import (
    COLUMNS,
    EXCESS,
    SHORT,
    SPREAD,
    UNLIKELY,
    WRONG,
    fit,
)
from zeromethod.surface.far_field_laws import ONE_LAW, OWN_LAWS, SET_LAWS, Known, Nodes, equations
from zeromethod.surface.far_field_shapes import BALL, LAW, LAYER, NUMBERS, POINT, with_law
from zeromethod.surface.far_field_starts import FREE_LAW, Tried, best_one, best_two, tried_dents

SURE, _FAR, _CLOSE, _LAYERS = 0.03, 6.0, 0.02, (0.1, 0.6)
"""Error of a law up to which others are left out that are so many standard deviations, and more, from the one
fitted; the laws that a layer's dent is taken for."""

EXPLAINED = 2.5
"""Logarithm of likelihood by which a law is wrong from which a second dent is tried."""

_ROUGHLY2, LEAST_WRONG2 = 1e-2, 1e-4
"""Square of a law's error for dents to start from: in all slopes, and least in what is left of them."""

PASSES = 24
"""Most passes of a fit."""

_WORTH = 0.05
"""Share of what is left that a further dent must explain to be tried, and logarithm of likelihood for each
slope that it must gain for one more."""

_SEEN_BEYOND = 0.15
"""Way beyond the view, over its extent, up to which a further dent is looked for closely."""

_A_FEW, _NO_USE = 3, 0.3
"""Passes by which a law of another kind shows whether it is of use, and `UNLIKELY` more than without it where
it is not."""

_MOST = 4
"""Dents at most."""

OF_TWO, OF_OWN_LAWS = 4, 3 * _MOST - 1
"""Members: two dents with one law; two to most with their own, and two other kinds of law of each."""


@numba.njit(cache=True, error_model="numpy")
def possible(member: Float, found: float, law: float) -> bool:
    """Whether a law may be the right one where the one fitted is `found`."""
    if not member[WRONG] < SURE or found >= BALL:
        return True
    low, high = (_LAYERS[0], _LAYERS[1]) if law == LAYER else (law, law)
    if law >= BALL:
        low, high = _LAYERS[0], np.inf
    spread = _FAR * member[SPREAD] + _CLOSE
    return bool(low - spread < found < high + spread)


@numba.njit(cache=True, error_model="numpy")
def fit_two(
    alone: Float,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    limits: Float,
    diagonal_mm: float,
    single: Float,
    members: Float,
) -> Float:
    """Fit two dents of one law: one beside the one found alone, a bulge around it, or two found together.

    Returns their numbers.
    """
    best, wrong2 = single[UNLIKELY], max(single[WRONG] ** 2, LEAST_WRONG2)
    found = equations(alone, SET_LAWS, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    beside = best_one(tried_dents(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm))[1]
    law = alone[LAW] if alone[LAW] >= 0.0 else 0.3
    starts = np.empty((3, 2 * NUMBERS))
    starts[0] = np.concatenate((alone, beside))
    starts[1] = np.concatenate((alone, alone))
    starts[:2, LAW::NUMBERS] = law
    starts[1, 0], starts[1, NUMBERS] = 1.15 * alone[0], -0.15 * alone[0]
    starts[1, NUMBERS + 3 : NUMBERS + LAW] *= 0.5
    starts[2] = best_two(all_slopes(nodes, quiet, known, limits, diagonal_mm))
    for k, passes in enumerate((SHORT, SHORT, 2 * SHORT)):
        fit(starts[k], ONE_LAW, passes, nodes, quiet, known, limits, best, members[k])
    two: Float = starts[np.argmin(members[:, UNLIKELY])]
    fit(two, ONE_LAW, PASSES, nodes, quiet, known, limits, best, members[0])
    for k, of_law in ((1, known.body.most_law), (2, 0.0), (3, POINT)):
        members[k, UNLIKELY] = np.inf
        if (k < 3 or of_law < known.body.most_law) and possible(members[0], two[LAW], of_law):
            same = with_law(two, of_law)
            fit(same, SET_LAWS, PASSES, nodes, quiet, known, limits, best, members[k])
    return two


@numba.njit(cache=True, error_model="numpy")
def _other_laws(
    dents: Float,
    dent: int,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    limits: Float,
    least: float,
    members: Float,
) -> tuple[int, Float]:
    """Fit with one dent's law of another kind, which no fit leads to; how many were tried, and the likeliest.

    least: `UNLIKELY` of the dents as they are, which are returned where that is the least.
    """
    begin, most = NUMBERS * dent, known.body.most_law
    tried, likeliest = 0, dents
    for law in (FREE_LAW, most, BALL + 0.5 * (most - POINT)):
        if law == POINT or _of_a_kind(dents[begin + LAW], law):
            continue
        other = dents.copy()
        other[begin : begin + NUMBERS] = with_law(other[begin : begin + NUMBERS], law)
        for passes in (_A_FEW, SHORT):
            fit(other, OWN_LAWS, passes, nodes, quiet, known, limits, np.inf, members[tried])
            if members[tried, UNLIKELY] > least + _NO_USE:
                break
        if members[tried, UNLIKELY] < least:
            least, likeliest = members[tried, UNLIKELY], other
        tried += 1
    return tried, likeliest


@numba.njit(cache=True, error_model="numpy")
def _of_a_kind(law: float, other: float) -> bool:
    """Whether a fit may lead from one law to another."""
    return (law > POINT) == (other > POINT) and (law >= BALL) == (other >= BALL)


@numba.njit(cache=True, error_model="numpy")
def fit_own(
    alone: Float,
    two: Float,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    limits: Float,
    diagonal_mm: float,
    members: Float,
) -> Float:
    """Fit two dents, each with its own law, and more while what is left asks for it; the likeliest's numbers.

    alone: numbers of a dent found alone; two: of two with one law. members: `OF_OWN_LAWS` of them.
    """
    start, dents = np.empty((2, COLUMNS)), two.copy()
    worth, beside = _further(alone, _ROUGHLY2, nodes, quiet, known, limits, diagonal_mm)
    if worth > _WORTH:
        fit(dents, OWN_LAWS, SHORT, nodes, quiet, known, limits, np.inf, start[0])
        fit(beside, OWN_LAWS, SHORT, nodes, quiet, known, limits, np.inf, start[1])
        dents = beside if start[1, UNLIKELY] < start[0, UNLIKELY] else dents
    before, likeliest = np.inf, dents
    for k in range(_MOST - 1):
        fit(dents, OWN_LAWS, PASSES, nodes, quiet, known, limits, np.inf, members[k])
        likeliest = dents if members[k, UNLIKELY] < before else likeliest
        if members[k, EXCESS] < EXPLAINED or members[k, UNLIKELY] > before - _WORTH:
            break
        before, wrong2 = members[k, UNLIKELY], max(members[k, WRONG] ** 2, LEAST_WRONG2)
        worth, dents = _further(dents, wrong2, nodes, quiet, known, limits, diagonal_mm)
        if worth < _WORTH:
            break
    used = _MOST - 1
    for dent in range(len(likeliest) // NUMBERS):
        least = members[:used, UNLIKELY].min()
        tried, likeliest = _other_laws(likeliest, dent, nodes, quiet, known, limits, least, members[used:])
        used += tried
    return likeliest


@numba.njit(cache=True, error_model="numpy")
def _further(
    dents: Float, wrong2: float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float
) -> tuple[float, Float]:
    """Share that one more dent explains of what some leave, and the numbers of all; none is a layer's.

    wrong2: square of the law's error. It is looked for everywhere, and closely about the view.
    """
    left = equations(dents, SET_LAWS, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    close, most, found = limits.copy(), 0.0, np.zeros(NUMBERS)
    for axis, at in ((0, nodes.x), (1, nodes.y)):
        beyond = _SEEN_BEYOND * (at.max() - at.min())
        close[axis] = at.min() - beyond, at.max() + beyond
    for region in (limits, close):
        tried = tried_dents(left.left, left.variance, nodes, quiet, known, region, diagonal_mm)
        share, one = best_one(tried)
        if share > most:
            most, found = share, one
    out = np.concatenate((dents, found))
    out[LAW::NUMBERS] = np.maximum(out[LAW::NUMBERS], 0.0)
    return most, out


@numba.njit(cache=True, error_model="numpy")
def all_slopes(nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float) -> Tried:
    """Dents tried for the slopes as they were read."""
    none = np.array([0.0, nodes.x[0], nodes.y[0], 1.0 / diagonal_mm, 0.0, 1.0 / diagonal_mm, 0.5])
    found = equations(none, SET_LAWS, nodes, quiet, known, _ROUGHLY2, np.ones((2, len(nodes.x))))
    return tried_dents(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)
