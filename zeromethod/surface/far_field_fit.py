"""Dents of one law fitted to slopes, and how well that says the multiple C of the scale; compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.far_field_laws import (
    ONE_LAW,
    OWN_LAWS,
    SET_LAWS,
    Equations,
    Known,
    Nodes,
    added_by_body,
    equations,
    nearest2,
)
from zeromethod.surface.far_field_shapes import LAW, NUMBERS, dents_end, ends_of_law

_PIECES, _NOISES = 14.0, 250.0
"""Independent errors of a law over the view, and those of noise."""

_ROUND, _LAW = 0.4, 0.5
"""Standard deviation of a dent's logarithm of length over width, and of its law, before anything is read."""

_WRONG2, _WRONG2_OF_TWO, _LEAST_WRONG2, MOST_WRONG2 = 1e-3, 0.03, 1e-6, 0.25
"""Square of a law's relative error: to begin with, by one dent and by two; least and largest."""

_DOUBTED2 = 0.01
"""Square of a law's error from which it says little: depth may be off by more than slopes are."""

_BODY = 0.01
"""What is open of the depth that the body adds to loads, relative."""

_LONGEST = 10.0
"""Length of a dent over its width, at most."""

SHORT = 8
"""Passes of a fit that finds out where to start; a longer one that is hopeless by then ends."""

_HOPELESS = 1.0
"""`UNLIKELY` more than that of the best member with which no fit goes on for long."""

_SETTLED = 1e-3
"""Gain of a step, in squared sigmas, by which a fit has settled."""

_FOLLOWED, _SAME_WRONG2 = 10, 0.02
"""Most steps by which a law's error follows numbers that are found, and change of its logarithm then."""

UNLIKELY, CONSTANT, VARIANCE, WRONG, NOISE, COUNT, SPREAD, EXCESS = range(8)
"""Columns of a member: -log of likelihood for each slope, C, its variance, the law's error, the share of
noise in what it leaves, how many numbers it has, the standard deviation of its law, and the logarithm of
likelihood by which it is wrong at all."""

COLUMNS = 8


@numba.njit(cache=True, error_model="numpy")
def _solve(normal: Float, right: Float, damping: float) -> tuple[bool, Float]:
    """Solution of the equations, the diagonal raised by damping, by Cholesky; whether there is one."""
    n = len(right)
    root, out = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        for j in range(i + 1):
            total = normal[i, j] * (1.0 + damping if i == j else 1.0)
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = total / root[j, j]
            elif total > 1e-13 * normal[i, i]:
                root[i, i] = np.sqrt(total)
            else:
                return False, out
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= root[i, k] * out[k]
        out[i] = total / root[i, i]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, n):
            total -= root[k, i] * out[k]
        out[i] = total / root[i, i]
    return True, out


@numba.njit(cache=True, error_model="numpy")
def _free(k: int, laws: int) -> bool:
    """Whether the law of the dent whose numbers begin at k is fitted."""
    return laws != SET_LAWS and (k == 0 or laws != ONE_LAW)


@numba.njit(cache=True, error_model="numpy")
def _expect(
    numbers: Float, strength: float, laws: int, most_law: float, found: Equations, ends: float = 0.0
) -> float:
    """Add to the equations what is expected of dents and of laws that are fitted; squares of that.

    A law that its end stops is as one that is not fitted; or as near its end as it must be, if the equations
    times `ends` are the logarithm of likelihood.
    """
    normal, right = found.normal, found.right
    for k in range(0, dents_end(numbers), NUMBERS):
        law = k + LAW
        low, high = ends_of_law(numbers[law], most_law)
        inside = low < numbers[law] + np.sign(right[law]) * 1e-9 < high
        if _free(k, laws) and (inside or ends > 0.0):
            normal[law, law] += strength / _LAW**2 + (0.0 if inside else ends * right[law] ** 2)
        else:
            normal[law], normal[:, law], right[law], normal[law, law] = 0.0, 0.0, 0.0, 1.0
            found.of_border[law] = 0.0
    weight, squares = strength / _ROUND**2, 0.0
    for k in range(3, dents_end(numbers), NUMBERS):
        a, b, c = numbers[k], numbers[k + 1], numbers[k + 2]
        longer = np.log(a / c)
        squares += weight * (longer * longer + b * b / (a * c))
        normal[k, k] += weight / (a * a)
        normal[k + 2, k + 2] += weight / (c * c)
        normal[k, k + 2] -= weight / (a * c)
        normal[k + 2, k] -= weight / (a * c)
        normal[k + 1, k + 1] += weight / (a * c)
        right[k] -= weight * longer / a
        right[k + 2] += weight * longer / c
        right[k + 1] -= weight * b / (a * c)
    return squares


@numba.njit(cache=True, error_model="numpy")
def _allowed(numbers: Float, limits: Float) -> bool:
    """Whether all dents lie within limits (4, 2): of x, of y, of size, and of depth, mm."""
    for k in range(0, dents_end(numbers), NUMBERS):
        depth, x, y, a, b, c = numbers[k : k + LAW]
        if not (a > 0.0 and c > 0.0 and a < _LONGEST * c and c < _LONGEST * a and b * b < 4.0 * a * c):
            return False
        place = np.array([x, y, 1.0 / np.sqrt(a * c), depth])
        if not ((limits[:, 0] < place) & (place < limits[:, 1])).all():
            return False
    return True


@numba.njit(cache=True, error_model="numpy")
def _bound(numbers: Float, before: Float, laws: int, most_law: float) -> None:
    """Keep fitted laws between their ends, and one of all the same."""
    for k in range(0, dents_end(numbers), NUMBERS):
        if _free(k, laws):
            low, high = ends_of_law(before[k + LAW], most_law)
            numbers[k + LAW] = min(max(numbers[k + LAW], low), high)
        elif laws == ONE_LAW:
            numbers[k + LAW] = numbers[LAW]


@numba.njit(cache=True, error_model="numpy")
def _wrong2(growth: float, wrong2: float) -> float:
    """Square of the law's error that explains what is left better than the one before, `Equations.growth`."""
    better = min(max(wrong2 + growth, 0.01 * wrong2), 20.0 * wrong2)
    return min(max(better, _LEAST_WRONG2), MOST_WRONG2)


@numba.njit(cache=True, error_model="numpy")
def fit(
    numbers: Float,
    laws: int,
    passes: int,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    limits: Float,
    best: float,
    out: Float,
) -> None:
    """Fit dents' numbers (p,), in place, by Levenberg and Marquardt's steps; fill in a member `out`.

    laws: which are fitted too. Their error is fitted with them. best: least `UNLIKELY` so far.
    """
    strength = 2.0 * known.weight.sum() / _PIECES
    wrong2, damping = _WRONG2_OF_TWO if len(numbers) >= 2 * NUMBERS else _WRONG2, 1e-3
    found = equations(numbers, laws, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    own = _expect(numbers, strength, laws, known.body.most_law, found)
    for k in range(passes):
        solved, step = _solve(found.normal, found.right, damping)
        better = _wrong2(found.growth, wrong2)
        if solved and step @ found.right < _SETTLED and abs(np.log(better / wrong2)) < 0.3:
            break
        if k == SHORT:
            found, own, wrong2 = _settled(numbers, laws, wrong2, own, found, strength, nodes, quiet, known)
            if _unlikely(found, known) > best + _HOPELESS:
                break
        new = numbers + step
        _bound(new, numbers, laws, known.body.most_law)
        if solved and _allowed(new, limits):
            tried = equations(new, laws, nodes, quiet, known, better, found.variance)
            own_new = _expect(new, strength, laws, known.body.most_law, tried)
            if tried.before + own_new < found.misfit + own:
                numbers[:], found, own, wrong2 = new, tried, own_new, better
                damping = max(0.1 * damping, 1e-7)
                continue
        damping = max(10.0 * damping, 1e-2)
        if damping > 1e6:
            break
    found, own, wrong2 = _settled(numbers, laws, wrong2, own, found, strength, nodes, quiet, known)
    _judge(numbers, laws, wrong2, found, nodes, quiet, known, out)


@numba.njit(cache=True, error_model="numpy")
def _settled(
    numbers: Float,
    laws: int,
    wrong2: float,
    own: float,
    found: Equations,
    strength: float,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
) -> tuple[Equations, float, float]:
    """Equations, squares of what is expected, and the law's error that explains best what numbers leave.

    Else a fit that ends before its law's error has followed counts as too unlikely by far.
    """
    followed2 = _followed(wrong2, found, nodes, known)
    if followed2 != wrong2:
        found = equations(numbers, laws, nodes, quiet, known, followed2, found.variance)
        own = _expect(numbers, strength, laws, known.body.most_law, found)
    return found, own, followed2


@numba.njit(cache=True, error_model="numpy")
def _followed(wrong2: float, found: Equations, nodes: Nodes, known: Known) -> float:
    """Square of the law's error that explains best what `found` leaves with wrong2: only variance changes."""
    better, of_law = _wrong2(found.growth, wrong2), np.empty((2, len(nodes.x)))
    of_law[0] = (found.variance[0] - nodes.variance_x) / wrong2
    of_law[1] = (found.variance[1] - nodes.variance_y) / wrong2
    for _ in range(_FOLLOWED):
        if abs(np.log(better / wrong2)) < _SAME_WRONG2:
            break
        wrong2, lacking, expected = better, 0.0, 0.0
        for i in range(len(known.weight)):
            for axis, noise2 in ((0, nodes.variance_x[i]), (1, nodes.variance_y[i])):
                variance = noise2 + wrong2 * of_law[axis, i]
                share, left = of_law[axis, i] / variance, found.left[axis, i]
                lacking += known.weight[i] * share * (left * left / variance - 1.0)
                expected += known.weight[i] * share * share
        better = _wrong2(lacking / max(expected, 1e-300), wrong2)
    return wrong2


@numba.njit(cache=True, error_model="numpy")
def _unlikely(found: Equations, known: Known) -> float:
    """-log of the likelihood of each slope that is left, but for a constant."""
    total = found.misfit
    for i in range(len(known.weight)):
        total += known.weight[i] * np.log(found.variance[0, i] * found.variance[1, i])
    return float(total / (2.0 * known.weight.sum()))


@numba.njit(cache=True, error_model="numpy")
def _judge(
    numbers: Float,
    laws: int,
    wrong2: float,
    found: Equations,
    nodes: Nodes,
    quiet: Nodes,
    known: Known,
    out: Float,
) -> None:
    """Fill in a member by its fitted numbers and the equations of `fit`."""
    total = 2.0 * known.weight.sum()
    noise = excess = 0.0
    for i in range(len(known.weight)):
        of_x, of_y = nodes.variance_x[i] / found.variance[0, i], nodes.variance_y[i] / found.variance[1, i]
        noise += known.weight[i] * (of_x + of_y)
        without = found.left[0, i] ** 2 / nodes.variance_x[i] + found.left[1, i] ** 2 / nodes.variance_y[i]
        excess += 0.5 * known.weight[i] * (without + np.log(of_x * of_y))
    independent, constant = pieces(noise / total), known.rest_mm - found.border_mm
    out[COUNT] = len(numbers)
    for k in range(0, dents_end(numbers), NUMBERS):
        # one of several that its end stops needs no more than one that is not fitted
        stops = laws == OWN_LAWS and found.normal[k + LAW, k] == 0.0
        out[COUNT] -= 0.0 if _free(k, laws) and not stops else 1.0
    if laws == OWN_LAWS:
        found = equations(numbers, laws, nodes, quiet, known, wrong2, found.variance)
        _expect(numbers, total / independent, laws, known.body.most_law, found, independent / total)
    else:
        _expect(numbers, total / independent - total / _PIECES, laws, known.body.most_law, found)
    solved, moved = _solve(found.normal, found.of_border, 1e-9)
    variance = (found.of_border @ moved) * total / independent * max(found.misfit / total, 1.0)
    if laws != SET_LAWS and found.normal[LAW, 0] != 0.0:
        only = np.zeros(len(numbers))
        only[LAW] = 1.0
        of_law = _solve(found.normal, only, 1e-9)[1][LAW]
        out[SPREAD] = np.sqrt(of_law * total / independent * max(found.misfit / total, 1.0))
    else:
        out[SPREAD] = 0.0
    out[UNLIKELY], out[CONSTANT] = _unlikely(found, known), constant
    implied2, doubt = _implied2(numbers, constant, quiet, known), wrong2 / _DOUBTED2
    slower2 = max(implied2, _slowest2(numbers, quiet, known))
    variance += (_BODY * added_by_body(numbers, quiet, known)) ** 2
    out[VARIANCE] = variance + wrong2 * (implied2 + doubt * doubt * slower2) if solved else np.inf
    out[EXCESS] = excess - 0.5 * found.misfit if wrong2 > _LEAST_WRONG2 else 0.0
    out[WRONG], out[NOISE] = np.sqrt(wrong2), noise / total


@numba.njit(cache=True, error_model="numpy")
def _implied2(numbers: Float, constant: float, quiet: Nodes, known: Known) -> float:
    """Square of depth / h, mm^2, that the slopes at the anchor imply if depth falls as 1 / r."""
    near2, total = nearest2(numbers, quiet.x, quiet.y), 0.0
    for i in range(len(known.share)):
        x = quiet.slope_x[i] - constant * quiet.gradient_x[i]
        y = quiet.slope_y[i] - constant * quiet.gradient_y[i]
        slope2 = x * x + y * y - 2.0 * (quiet.variance_x[i] + quiet.variance_y[i])
        total += known.share[i] * near2[i] * slope2 / quiet.scale[i] ** 2
    return max(total, 0.0)


@numba.njit(cache=True, error_model="numpy")
def _slowest2(numbers: Float, quiet: Nodes, known: Known) -> float:
    """Square of depth / h, mm^2, at the anchor if all dents fell as 1 / r from where they are steepest."""
    total = 0.0
    for i in range(len(known.share)):
        depth = 0.0
        for k in range(0, dents_end(numbers), NUMBERS):
            across, down = quiet.x[i] - numbers[k + 1], quiet.y[i] - numbers[k + 2]
            size2 = 1.0 / (numbers[k + 3] * numbers[k + 5])
            depth += abs(numbers[k]) * np.sqrt(size2 / (across * across + down * down + size2))
        total += known.share[i] * (depth / quiet.scale[i]) ** 2
    return total


@numba.njit(cache=True, error_model="numpy")
def pieces(noise: float) -> float:
    """Independent errors in what is left of the slopes, by the share of noise in it."""
    return float(1.0 / ((1.0 - noise) / _PIECES + noise / _NOISES))
