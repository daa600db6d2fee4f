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
    UNLIKELY,
    VARIANCE,
    WRONG,
    fit,
    pieces,
)
from zeromethod.surface.far_field_laws import ONE_LAW, SET_LAWS, Known, Nodes, equations
from zeromethod.surface.far_field_several import (
    EXPLAINED,
    LEAST_WRONG2,
    OF_OWN_LAWS,
    OF_TWO,
    PASSES,
    SURE,
    all_slopes,
    fit_own,
    fit_two,
    possible,
)
from zeromethod.surface.far_field_shapes import BALL, LAW, LAYER, NUMBERS, POINT, ends_of_law, with_law
from zeromethod.surface.far_field_starts import best_one
from zeromethod.surface.weak_dents import further_far_field

_UNFIT = 0.15
"""Error of a law from which a fit may have ended in a wrong place."""

_CLEARLY = 0.5
"""What a start leaves over what another one does, from which it is clearly better."""

_MOVED_COST = 9.0
"""Logarithm of likelihood that a tilted mirror must gain: in one frame of 10,000 a bench has moved."""

_UNLIKE = 0.006
"""Error of one law from which dents may have laws of their own."""

_BEYOND, _LARGEST, _SMALLEST, _DEEPEST = 1.2, 1.5, 0.005, 10.0
"""Limits of a dent: way beyond the view and sizes over its diagonal, depth over range."""

_RANGES, _MOST_RANGES = 1.0, 3.0
"""Of the anchor's depth over the range read: its standard deviation before anything is read, and where a law
that says more is doubted by as much as it says more. Such a dent moves what is seen hardly more than the
multiple of the scale that cannot be seen."""

_LOST = 15.0
"""Logarithm of likelihood by which a ball without what the body adds is off where no share of it helps."""

_LAWS = 5
_BALL = 2 * _LAWS
_TWO = _BALL + 3
_OWN = _TWO + OF_TWO
_MEMBERS = _OWN + OF_OWN_LAWS + 1
"""One dent by each law, the same from another start, a ball's, two dents by one law, dents by laws of their
own, and one on a mirror that is tilted."""


@numba.njit(cache=True, error_model="numpy")
def posterior(
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    starts: Float,
    range_mm: float,
    diagonal_mm: float,
    several: bool,
) -> tuple[float, float]:
    """Mean and standard deviation of C, mm.

    starts: numbers (2, 7) of dents to start from, the second where it is clearly better. range_mm: of depth
    read; diagonal_mm: of the view. several: whether several dents are tried.
    """
    limits, members = _limits(nodes, range_mm, diagonal_mm), np.full((_MEMBERS, COLUMNS), np.inf)
    start = _better_start(starts, nodes, quiet, known)
    of_load = 1 if known.body.most_law == POINT else 4
    one, best = _begun(start, nodes, quiet, known, limits, members[2], members[of_load]), 0
    alone = one.copy()
    for turn in range(2):
        first = turn * _LAWS
        fit(one, ONE_LAW, PASSES, nodes, quiet, known, limits, members[best, UNLIKELY], members[first])
        best = first if turn == 0 or members[first, UNLIKELY] < members[best, UNLIKELY] else best
        if best == first:
            alone[:] = one
        for k, law in ((1, known.body.most_law), (2, 0.0), (3, LAYER), (4, POINT)):
            if k == 4 and law == known.body.most_law:
                continue
            if turn == 0 and (members[k, WRONG] < SURE or not possible(members[0], one[LAW], law)):
                continue
            same, member = with_law(alone if members[best, WRONG] < _UNFIT else one, law), members[first + k]
            fit(same, SET_LAWS, PASSES, nodes, quiet, known, limits, members[best, UNLIKELY], member)
            if member[UNLIKELY] < members[best, UNLIKELY]:
                best, alone[:] = first + k, same
        # by one dent alone a constant is found only if it fits: else another start may
        if members[best, WRONG] < (_UNFIT if several else SURE):
            break
        one[:] = best_one(all_slopes(nodes, quiet, known, limits, diagonal_mm))[1]
    found = alone
    if possible(members[0], one[LAW], BALL):
        ball = _fit_ball(alone, nodes, quiet, known, limits, members[best], members[_BALL:_TWO])
        best = int(np.argmin(members[:, UNLIKELY]))
        found = ball if best >= _BALL else alone
    if several and members[best, EXCESS] > EXPLAINED:
        two = fit_two(alone, nodes, quiet, known, limits, diagonal_mm, members[best], members[_TWO:_OWN])
        best = int(np.argmin(members[:, UNLIKELY]))
        if (best >= _TWO or members[best, EXCESS] > EXPLAINED) and members[best, WRONG] > _UNLIKE:
            two = fit_own(alone, two, nodes, quiet, known, limits, diagonal_mm, members[_OWN:-1])
        best = int(np.argmin(members[:, UNLIKELY]))
        found = two if best >= _TWO else found
    _fit_tilted(start, nodes, quiet, known, limits, members[:, UNLIKELY].min(), members[-1])
    mean, sigma = _together(members, known.rest_mm, _RANGES * range_mm)
    wrong2 = max(members[best, WRONG] ** 2, LEAST_WRONG2)
    left = equations(found, SET_LAWS, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    shared = 2.0 * known.weight.sum() / pieces(members[best, NOISE])
    deeper, open_mm = further_far_field(left.left, left.variance, shared, nodes, quiet, known)
    return mean - deeper, np.hypot(sigma, open_mm)


@numba.njit(cache=True, error_model="numpy")
def _better_start(starts: Float, nodes: Nodes, quiet: Nodes, known: Known) -> Float:
    """The first of two dents, unless the other one explains the slopes clearly better; as Gaussians."""
    none, off = np.ones((2, len(nodes.x))), np.empty(2)
    for k in range(2):
        dent = with_law(starts[k], 0.0)
        off[k] = equations(dent, SET_LAWS, nodes, quiet, known, MOST_WRONG2, none).misfit
    better: Float = starts[1] if off[1] < _CLEARLY * off[0] else starts[0]
    return better


@numba.njit(cache=True, error_model="numpy")
def _begun(
    start: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, gaussian: Float, point: Float
) -> Float:
    """Numbers of a dent fitted with the likelier of two laws held, from which a fit of its law ends sooner.

    gaussian, point: members of these laws; the likelier is filled in, and the other one if that is off.
    """
    none, least = np.ones((2, len(nodes.x))), np.inf
    two = np.stack((with_law(start, 0.0), with_law(start, POINT)))
    off = [equations(each, SET_LAWS, nodes, quiet, known, MOST_WRONG2, none).misfit for each in two]
    found: Float = two[0]
    for k in (0, 1) if off[0] < off[1] else (1, 0):
        member = point if k else gaussian
        fit(two[k], SET_LAWS, PASSES, nodes, quiet, known, limits, least, member)
        if member[UNLIKELY] < least:
            least, found = member[UNLIKELY], two[k]
        if member[WRONG] < SURE:
            break
    return found


@numba.njit(cache=True, error_model="numpy")
def _fit_ball(
    alone: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, best: Float, members: Float
) -> Float:
    """Fit a ball's dent, with no share of what the body adds, all of it, and any; the likeliest's numbers.

    alone: numbers of the best member, `best`.
    """
    low, high = ends_of_law(BALL, known.body.most_law)
    likeliest, least = _begun_as_ball(alone, low, nodes), best[UNLIKELY]
    fit(likeliest, SET_LAWS, PASSES, nodes, quiet, known, limits, least, members[0])
    if high == low or pieces(best[NOISE]) * (members[0, UNLIKELY] - least) > _LOST:
        return likeliest
    # begun where another share ended, they gain next to nothing in more passes
    for k, law in ((1, high), (2, 0.5 * (low + high))):
        one = with_law(likeliest, law)
        fit(one, ONE_LAW if k == 2 else SET_LAWS, SHORT, nodes, quiet, known, limits, least, members[k])
        if members[k, UNLIKELY] < members[:k, UNLIKELY].min():
            likeliest = one
    return likeliest


@numba.njit(cache=True, error_model="numpy")
def _begun_as_ball(dent: Float, law: float, nodes: Nodes) -> Float:
    """Numbers (7,) of a ball's dent to fit where one of another law was: at least as wide as its dark middle.

    Else nodes which see none of this middle leave it too steep to lead to a ball.
    """
    ball = with_law(dent, law)
    across, down = nodes.x - ball[1], nodes.y - ball[2]
    wider = np.sqrt(max(np.min((ball[3] * across + ball[4] * down) ** 2 + (ball[5] * down) ** 2), 1.0))
    # as deep in the view: it falls about as 1 / r there
    ball[0] /= wider
    ball[3:LAW] /= wider
    return ball


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
def _fit_tilted(
    start: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, best: float, member: Float
) -> None:
    """Fit a dent on a mirror that seems tilted: camera or LCD may have moved under it.

    Then depth is off by the tilt, which goes into the variance.
    """
    tilted = np.concatenate((start, np.zeros(2)))
    fit(tilted, ONE_LAW, PASSES, nodes, quiet, known, limits, best, member)
    off_mm = tilted[NUMBERS] * (nodes.x - known.share @ quiet.x)
    off_mm += tilted[NUMBERS + 1] * (nodes.y - known.share @ quiet.y)
    member[VARIANCE] += np.mean(off_mm**2)


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
