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
    MOST_WRONG2,
    NOISE,
    SHORT,
    SPREAD,
    UNLIKELY,
    VARIANCE,
    WRONG,
    fit,
    pieces,
)
from zeromethod.surface.far_field_laws import (
    LAW,
    LAYER,
    NUMBERS,
    ONE_LAW,
    OWN_LAWS,
    POINT,
    SET_LAWS,
    Known,
    Nodes,
    dents_end,
    equations,
)
from zeromethod.surface.far_field_starts import Tried, best_one, best_two, tried_dents
from zeromethod.surface.weak_dents import further_far_field

_UNFIT = 0.15
"""Error of a law from which a fit may have ended in a wrong place."""

_SURE, _FAR, _CLOSE, _LAYERS = 0.03, 6.0, 0.02, (0.1, 0.6)
"""Error of a law up to which others are left out that are so many standard deviations, and more, from the one
fitted; the laws that a layer's dent is taken for."""

_EXPLAINED = 2.5
"""Logarithm of likelihood by which a law is wrong from which a second dent is tried."""

_ROUGHLY2, _LEAST_WRONG2 = 1e-2, 1e-4
"""Square of a law's error for dents to start from: in all slopes, and least in what is left of them."""

_MOVED_COST = 9.0
"""Logarithm of likelihood that a tilted mirror must gain: in one frame of 10,000 a bench has moved."""

_PASSES = 24
"""Most passes of a fit."""

_BEYOND, _LARGEST, _SMALLEST, _DEEPEST = 1.2, 1.5, 0.005, 10.0
"""Limits of a dent: way beyond the view and sizes over its diagonal, depth over range."""

_RANGES, _MOST_RANGES = 1.0, 3.0
"""Of the anchor's depth over the range read: its standard deviation before anything is read, and where a law
that says more is doubted by as much as it says more. Such a dent moves what is seen hardly more than the
multiple of the scale that cannot be seen."""

_UNLIKE = 0.006
"""Error of one law from which dents may have laws of their own."""

_WORTH = 0.05
"""Share of what is left that a further dent must explain to be tried, and logarithm of likelihood for each
slope that it must gain for one more."""

_SEEN_BEYOND = 0.15
"""Way beyond the view, over its extent, up to which a further dent is looked for closely."""

_TWO, _OWN, _MEMBERS = 10, 14, 18
"""Five of one dent, as many from another start, four of two with one law; two to four
dents, each with its own law; and last one on a mirror that is tilted."""


@numba.njit(cache=True, error_model="numpy")
def posterior(
    nodes: Nodes, quiet: Nodes, known: Known, start: Float, range_mm: float, diagonal_mm: float
) -> tuple[float, float]:
    """Mean and standard deviation of C, mm.

    start: numbers (7,) of a dent to start from. range_mm: of depth read; diagonal_mm: of the view.
    """
    limits, members = _limits(nodes, range_mm, diagonal_mm), np.full((_MEMBERS, COLUMNS), np.inf)
    of_load = 1 if known.body.most_law == POINT else 4
    one, best = _begun(start, nodes, quiet, known, limits, members[2], members[of_load]), 0
    alone = one.copy()
    for turn in range(2):
        first = 5 * turn
        fit(one, ONE_LAW, _PASSES, nodes, quiet, known, limits, members[best, UNLIKELY], members[first])
        best = first if turn == 0 or members[first, UNLIKELY] < members[best, UNLIKELY] else best
        if best == first:
            alone[:] = one
        for k, law in ((1, known.body.most_law), (2, 0.0), (3, LAYER), (4, POINT)):
            if k == 4 and law == known.body.most_law:
                continue
            if turn == 0 and (members[k, WRONG] < _SURE or not _possible(members[0], one[LAW], law)):
                continue
            same = _same_scale(alone if members[best, WRONG] < _UNFIT else one, law)
            fit(
                same,
                SET_LAWS,
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
        one[:] = best_one(_all_slopes(nodes, quiet, known, limits, diagonal_mm))[1]
    if members[best, EXCESS] > _EXPLAINED:
        two = _fit_two(alone, nodes, quiet, known, limits, diagonal_mm, members[best], members[_TWO:_OWN])
        best = int(np.argmin(members[:, UNLIKELY]))
        if members[best, EXCESS] > _EXPLAINED and members[best, WRONG] > _UNLIKE:
            two = _fit_own(alone, two, nodes, quiet, known, limits, diagonal_mm, members[_OWN:-1])
        best = int(np.argmin(members[:, UNLIKELY]))
        alone = two if best >= _TWO else alone
    _fit_tilted(start, nodes, quiet, known, limits, members[:, UNLIKELY].min(), members[-1])
    mean, sigma = _together(members, known.rest_mm, _RANGES * range_mm)
    wrong2 = max(members[best, WRONG] ** 2, _LEAST_WRONG2)
    left = equations(alone, SET_LAWS, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    shared = 2.0 * known.weight.sum() / pieces(members[best, NOISE])
    deeper, open_mm = further_far_field(left.left, left.variance, shared, nodes, quiet, known)
    return mean - deeper, np.hypot(sigma, open_mm)


@numba.njit(cache=True, error_model="numpy")
def _begun(
    start: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, gaussian: Float, point: Float
) -> Float:
    """Numbers of a dent fitted with the likelier of two laws held, from which a fit of its law ends sooner.

    gaussian, point: members of these laws; the likelier is filled in, and the other one if that is off.
    """
    none, least = np.ones((2, len(nodes.x))), np.inf
    two = np.stack((_same_scale(start, 0.0), _same_scale(start, POINT)))
    off = [equations(each, SET_LAWS, nodes, quiet, known, MOST_WRONG2, none).misfit for each in two]
    found: Float = two[0]
    for k in (0, 1) if off[0] < off[1] else (1, 0):
        member = point if k else gaussian
        fit(two[k], SET_LAWS, _PASSES, nodes, quiet, known, limits, least, member)
        if member[UNLIKELY] < least:
            least, found = member[UNLIKELY], two[k]
        if member[WRONG] < _SURE:
            break
    return found


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
    out[LAW : dents_end(out) : NUMBERS] = law
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
    best, wrong2 = single[UNLIKELY], max(single[WRONG] ** 2, _LEAST_WRONG2)
    found = equations(alone, SET_LAWS, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    beside = best_one(tried_dents(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm))[1]
    law = alone[LAW] if alone[LAW] >= 0.0 else 0.3
    starts = np.empty((3, 2 * NUMBERS))
    starts[0] = np.concatenate((alone, beside))
    starts[1] = np.concatenate((alone, alone))
    starts[:2, LAW::NUMBERS] = law
    starts[1, 0], starts[1, NUMBERS] = 1.15 * alone[0], -0.15 * alone[0]
    starts[1, NUMBERS + 3 : NUMBERS + LAW] *= 0.5
    starts[2] = best_two(_all_slopes(nodes, quiet, known, limits, diagonal_mm))
    for k, passes in enumerate((SHORT, SHORT, 2 * SHORT)):
        fit(starts[k], ONE_LAW, passes, nodes, quiet, known, limits, best, members[k])
    two: Float = starts[np.argmin(members[:, UNLIKELY])]
    fit(two, ONE_LAW, _PASSES, nodes, quiet, known, limits, best, members[0])
    for k, of_law in ((1, known.body.most_law), (2, 0.0), (3, POINT)):
        members[k, UNLIKELY] = np.inf
        if (k < 3 or of_law < known.body.most_law) and _possible(members[0], two[LAW], of_law):
            same = _same_scale(two, of_law)
            fit(same, SET_LAWS, _PASSES, nodes, quiet, known, limits, best, members[k])
    return two


@numba.njit(cache=True, error_model="numpy")
def _fit_own(
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

    alone: numbers of a dent found alone; two: of two with one law.
    """
    start, dents = np.empty((2, COLUMNS)), two.copy()
    worth, beside = _further(alone, _ROUGHLY2, nodes, quiet, known, limits, diagonal_mm)
    if worth > _WORTH:
        fit(dents, OWN_LAWS, SHORT, nodes, quiet, known, limits, np.inf, start[0])
        fit(beside, OWN_LAWS, SHORT, nodes, quiet, known, limits, np.inf, start[1])
        dents = beside if start[1, UNLIKELY] < start[0, UNLIKELY] else dents
    before, likeliest = np.inf, dents
    for k in range(len(members)):
        fit(dents, OWN_LAWS, _PASSES, nodes, quiet, known, limits, np.inf, members[k])
        likeliest = dents if members[k, UNLIKELY] < before else likeliest
        if members[k, EXCESS] < _EXPLAINED or members[k, UNLIKELY] > before - _WORTH:
            break
        before, wrong2 = members[k, UNLIKELY], max(members[k, WRONG] ** 2, _LEAST_WRONG2)
        worth, dents = _further(dents, wrong2, nodes, quiet, known, limits, diagonal_mm)
        if worth < _WORTH:
            break
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
def _fit_tilted(
    start: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, best: float, member: Float
) -> None:
    """Fit a dent on a mirror that seems tilted: camera or LCD may have moved under it.

    Then depth is off by the tilt, which goes into the variance.
    """
    tilted = np.concatenate((start, np.zeros(2)))
    fit(tilted, ONE_LAW, _PASSES, nodes, quiet, known, limits, best, member)
    off_mm = tilted[NUMBERS] * (nodes.x - known.share @ quiet.x)
    off_mm += tilted[NUMBERS + 1] * (nodes.y - known.share @ quiet.y)
    member[VARIANCE] += np.mean(off_mm**2)


@numba.njit(cache=True, error_model="numpy")
def _all_slopes(nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float) -> Tried:
    """Dents tried for the slopes as they were read."""
    none = np.array([0.0, nodes.x[0], nodes.y[0], 1.0 / diagonal_mm, 0.0, 1.0 / diagonal_mm, 0.5])
    found = equations(none, SET_LAWS, nodes, quiet, known, _ROUGHLY2, np.ones((2, len(nodes.x))))
    return tried_dents(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)


@numba.njit(cache=True, error_model="numpy")
def _together(members: Float, rest_mm: float, about_mm: float) -> tuple[float, float]:
    """Mean and standard deviation of C by all members, each as likely as it makes the slopes."""
    best = np.argmin(members[:, UNLIKELY])
    independent = pieces(members[best, NOISE])
    likely = -independent * members[:, UNLIKELY] - 0.5 * np.log(independent) * members[:, COUNT]
    likely[-1] -= _MOVED_COST
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
            own += max(abs(members[k, CONSTANT] - rest_mm) - _MOST_RANGES * about_mm, 0.0) ** 2
            variance += likely[k] * (own + off * off)
    return mean, np.sqrt(variance)
