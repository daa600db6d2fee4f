"""Dents fitted by each law of `far_field`, and what they say together of the multiple C of the scale; compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.surface.far_field_laws import LAYER, NUMBERS, Equations, Known, Nodes, equations, nearest2

_PIECES, _NOISES = 14.0, 250.0
"""Independent errors of a law over the view, and those of noise."""

_ROUND, _LAW = 0.4, 0.5
"""Standard deviation of a dent's logarithm of length over width, and of its law, before anything is read."""

_WRONG2, _LEAST_WRONG2, _MOST_WRONG2 = 1e-3, 1e-6, 0.25
"""Square of a law's relative error: to begin with, least and largest."""

_UNFIT = 0.15
"""Error of a law from which a fit may have ended in a wrong place."""

_EXPLAINED = 2.5
"""Logarithm of likelihood by which a law is wrong from which a second dent is tried."""

_PASSES, _SHORT = 24, 8
"""Most passes of a fit, and of one that finds out where to start."""

_SURE, _FAR, _CLOSE, _LAYERS = 0.03, 6.0, 0.02, (0.1, 0.6)
"""Error of a law up to which others are left out if they are standard deviations, and more, from the one fitted;
the laws that a layer's dent is taken for."""

_HOPELESS = 1.0
"""`_UNLIKELY` more than that of the best member with which no fit goes on for long."""

_SETTLED = 1e-3
"""Gain of a step, in squared sigmas, by which a fit has settled."""

_PLACES, _SIZES = (9, 7), (24.0, 12.0, 6.0, 3.0)
"""Places and sizes, the view's diagonal over it, of dents that are tried to start from."""

_BEYOND, _LARGEST, _SMALLEST, _LONGEST, _DEEPEST = 0.45, 1.5, 0.005, 10.0, 10.0
"""Limits of a dent: way beyond the view and sizes over its diagonal, length over width, depth over range."""

_RANGES = 1.0
"""Standard deviation of the anchor's depth over the range read, before anything is read."""

_MEMBERS = 11
_UNLIKELY, _CONSTANT, _VARIANCE, _WRONG, _NOISE, _COUNT, _SPREAD, _EXCESS = range(8)
"""Columns of a member: -log of likelihood for each slope, C, its variance, the law's error, the share of noise
in what it leaves, its numbers' count, the standard deviation of its law, and the logarithm of
likelihood by which it is wrong at all."""


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
def _expect(numbers: Float, strength: float, free: bool, found: Equations) -> float:
    """Add to the equations what is expected of dents and, if it is free, of their law; squares of that."""
    normal, right, last = found.normal, found.right, len(numbers) - 1
    if free:
        normal[last, last] += strength / _LAW**2
    else:
        normal[last], normal[:, last], right[last], normal[last, last] = 0.0, 0.0, 0.0, 1.0
    weight, squares = strength / _ROUND**2, 0.0
    for k in range(3, last, NUMBERS):
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
    for k in range(0, len(numbers) - 1, NUMBERS):
        depth, x, y, a, b, c = numbers[k : k + NUMBERS]
        if not (a > 0.0 and c > 0.0 and a < _LONGEST * c and c < _LONGEST * a and b * b < 4.0 * a * c):
            return False
        place = np.array([x, y, 1.0 / np.sqrt(a * c), depth])
        if not ((limits[:, 0] < place) & (place < limits[:, 1])).all():
            return False
    return True


@numba.njit(cache=True, error_model="numpy")
def _wrong2(found: Equations, wrong2: float) -> float:
    """Square of the law's error that explains what is left better than the one before."""
    better = min(max(wrong2 + found.growth, 0.01 * wrong2), 20.0 * wrong2)
    return min(max(better, _LEAST_WRONG2), _MOST_WRONG2)


@numba.njit(cache=True, error_model="numpy")
def fit(
    numbers: Float, free: bool, passes: int, nodes: Nodes, quiet: Nodes, known: Known, limits: Float,
    best: float, out: Float
) -> None:
    """Fit dents' numbers (p,), in place, by Levenberg and Marquardt's steps; fill in a member `out`.

    free: whether the law, the last number, is fitted too. The law's error is fitted with them. best: least
    `_UNLIKELY` so far.
    """
    strength = 2.0 * known.weight.sum() / _PIECES
    wrong2, damping = _WRONG2, 1e-3
    found = equations(numbers, nodes, quiet, known, wrong2, np.ones((2, len(nodes.x))))
    own = _expect(numbers, strength, free, found)
    for k in range(passes):
        solved, step = _solve(found.normal, found.right, damping)
        better = _wrong2(found, wrong2)
        if solved and step @ found.right < _SETTLED and abs(np.log(better / wrong2)) < 0.3:
            break
        if k == _SHORT and _unlikely(found, known) > best + _HOPELESS:
            break
        new = numbers + step
        new[-1] = min(max(new[-1], 0.0), 1.0) if free else numbers[-1]
        if solved and _allowed(new, limits):
            tried = equations(new, nodes, quiet, known, better, found.variance)
            at_end = new[-1] + np.sign(tried.right[-1]) * 1e-9
            own_new = _expect(new, strength, free and 0.0 < at_end < 1.0, tried)
            if tried.before + own_new < found.misfit + own:
                numbers[:], found, own, wrong2 = new, tried, own_new, better
                damping = max(0.1 * damping, 1e-7)
                continue
        damping = max(10.0 * damping, 1e-2)
        if damping > 1e6:
            break
    _judge(numbers, free, wrong2, found, nodes, quiet, known, out)


@numba.njit(cache=True, error_model="numpy")
def _unlikely(found: Equations, known: Known) -> float:
    """-log of the likelihood of each slope that is left, but for a constant."""
    total = found.misfit
    for i in range(len(known.weight)):
        total += known.weight[i] * np.log(found.variance[0, i] * found.variance[1, i])
    return total / (2.0 * known.weight.sum())


@numba.njit(cache=True, error_model="numpy")
def _judge(
    numbers: Float, free: bool, wrong2: float, found: Equations, nodes: Nodes, quiet: Nodes, known: Known, out: Float
) -> None:
    """Fill in a member by its fitted numbers and the equations of `fit`."""
    total = 2.0 * known.weight.sum()
    noise = excess = 0.0
    for i in range(len(known.weight)):
        of_x, of_y = nodes.variance_x[i] / found.variance[0, i], nodes.variance_y[i] / found.variance[1, i]
        noise += known.weight[i] * (of_x + of_y)
        without = found.left[0, i] ** 2 / nodes.variance_x[i] + found.left[1, i] ** 2 / nodes.variance_y[i]
        excess += 0.5 * known.weight[i] * (without + np.log(of_x * of_y))
    pieces, constant = _pieces(noise / total), known.rest_mm - found.border_mm
    # a law at its end is as one that is not fitted
    fitted = free and found.normal[-1, 0] != 0.0
    _expect(numbers, total / pieces - total / _PIECES, fitted, found)
    if not fitted:
        found.of_border[-1] = 0.0
    solved, moved = _solve(found.normal, found.of_border, 1e-9)
    variance = (found.of_border @ moved) * total / pieces * max(found.misfit / total, 1.0)
    if fitted:
        only = np.zeros(len(numbers))
        only[-1] = 1.0
        of_law = _solve(found.normal, only, 1e-9)[1][-1]
        out[_SPREAD] = np.sqrt(of_law * total / pieces * max(found.misfit / total, 1.0))
    else:
        out[_SPREAD] = 0.0
    out[_UNLIKELY], out[_CONSTANT] = _unlikely(found, known), constant
    out[_VARIANCE] = variance + wrong2 * _implied2(numbers, constant, quiet, known) if solved else np.inf
    out[_EXCESS] = excess - 0.5 * found.misfit if wrong2 > _LEAST_WRONG2 else 0.0
    out[_WRONG], out[_NOISE], out[_COUNT] = np.sqrt(wrong2), noise / total, len(numbers) - (0 if free else 1)


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
def _pieces(noise: float) -> float:
    """Independent errors in what is left of the slopes, by the share of noise in it."""
    return 1.0 / ((1.0 - noise) / _PIECES + noise / _NOISES)


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
    limits, members = _limits(nodes, range_mm, diagonal_mm), np.full((_MEMBERS, 8), np.inf)
    one, best = np.append(start, 0.5), 0
    alone = np.append(start, 0.5)
    for turn in range(2):
        first = 4 * turn
        fit(one, True, _PASSES, nodes, quiet, known, limits, members[best, _UNLIKELY], members[first])
        best = first if turn == 0 or members[first, _UNLIKELY] < members[best, _UNLIKELY] else best
        if best == first:
            alone[:] = one
        for k, law in ((1, 1.0), (2, 0.0), (3, LAYER)):
            if turn == 0 and not _possible(members[0], one[-1], law):
                continue
            same = _same_scale(alone if members[best, _WRONG] < _UNFIT else one, law)
            fit(same, False, _PASSES, nodes, quiet, known, limits, members[best, _UNLIKELY], members[first + k])
            if members[first + k, _UNLIKELY] < members[best, _UNLIKELY]:
                best, alone[:] = first + k, same
        if members[best, _WRONG] < _UNFIT:
            break
        one[:-1] = _placed_alone(nodes, quiet, known, limits, diagonal_mm)
        one[-1] = 0.5
    if members[best, _EXCESS] > _EXPLAINED:
        found = equations(alone, nodes, quiet, known, max(members[best, _WRONG] ** 2, 1e-4), np.ones((2, len(nodes.x))))
        beside = _placed(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)
        _fit_two(alone, beside, nodes, quiet, known, limits, diagonal_mm, members[best, _UNLIKELY], members[8:])
    return _together(members, known.rest_mm, _RANGES * range_mm)


@numba.njit(cache=True, error_model="numpy")
def _possible(member: Float, found: float, law: float) -> bool:
    """Whether a law may be the right one where the one fitted is `found`."""
    if not member[_WRONG] < _SURE:
        return True
    low, high = (_LAYERS[0], _LAYERS[1]) if law == LAYER else (law, law)
    spread = _FAR * member[_SPREAD] + _CLOSE
    return low - spread < found < high + spread


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
    alone: Float, beside: Float, nodes: Nodes, quiet: Nodes, known: Known, limits: Float, diagonal_mm: float, best: float, members: Float
) -> None:
    """Fit two dents of one law: from the one found alone with one beside it, or with a wide bulge around it."""
    law = np.full(1, alone[-1] if alone[-1] >= 0.0 else 0.3)
    two = np.concatenate((alone[:-1], beside, law))
    around = np.concatenate((alone[:-1], alone[:-1], law))
    around[0], around[NUMBERS] = 1.15 * alone[0], -0.15 * alone[0]
    around[NUMBERS + 3 : 2 * NUMBERS] *= 0.5
    fit(two, True, _SHORT, nodes, quiet, known, limits, best, members[0])
    fit(around, True, _SHORT, nodes, quiet, known, limits, best, members[1])
    if members[1, _UNLIKELY] < members[0, _UNLIKELY]:
        two[:] = around
        members[0] = members[1]
    if members[0, _WRONG] > _UNFIT:
        first = _placed_alone(nodes, quiet, known, limits, diagonal_mm)
        found = equations(np.append(first, 0.5), nodes, quiet, known, 1e-2, np.ones((2, len(nodes.x))))
        second = _placed(found.left, found.variance, nodes, quiet, known, limits, diagonal_mm)
        around[:] = np.concatenate((first, second, np.full(1, 0.5)))
        fit(around, True, 2 * _SHORT, nodes, quiet, known, limits, best, members[1])
        if members[1, _UNLIKELY] < members[0, _UNLIKELY]:
            two[:] = around
    fit(two, True, _PASSES, nodes, quiet, known, limits, best, members[0])
    for k, of_law in ((1, 1.0), (2, 0.0)):
        members[k, _UNLIKELY] = np.inf
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
    best = np.argmin(members[:, _UNLIKELY])
    pieces = _pieces(members[best, _NOISE])
    likely = -pieces * members[:, _UNLIKELY] - 0.5 * np.log(pieces) * members[:, _COUNT]
    likely = np.exp(likely - likely.max())
    likely /= likely.sum()
    # none is known better than that the anchor is about as deep as what is read
    kept = 1.0 / (1.0 + members[:, _VARIANCE] / about_mm**2)
    mean = variance = 0.0
    for k in range(len(members)):
        if likely[k] > 0.0:
            mean += likely[k] * (rest_mm + kept[k] * (members[k, _CONSTANT] - rest_mm))
    for k in range(len(members)):
        if likely[k] > 0.0:
            off = rest_mm + kept[k] * (members[k, _CONSTANT] - rest_mm) - mean
            own = about_mm**2 if members[k, _VARIANCE] == np.inf else kept[k] * members[k, _VARIANCE]
            variance += likely[k] * (own + off * off)
    return mean, np.sqrt(variance)
