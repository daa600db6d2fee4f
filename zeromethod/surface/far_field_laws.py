"""How likely each multiple C of the scale is, by the laws of a far field (`far_field`); compiled."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float

PIECES, MOST_NOISES = 12.0, 24.0
"""Independent errors of a law over the view, and most of the noise."""

_CORE_SHARE = 0.2
"""Depth over the largest at which the dent's core, which gives its centre, ends."""

_PARALLEL = 1e-3
"""Determinant over squared trace up to which the core's lines are parallel and have no centre."""

_SMALLEST, _FLAT = 0.03, 0.01
"""Error of the law's slope that is allowed for at each node, over r . s and over depth."""

_LEAST_MISFIT, _NO_CENTRE = 0.3, 1e6
"""Squares over those allowed of a law that fits perfectly, and of a C that leaves no centre."""

_OUTWARDS = 0.02
"""Share of the squares of slopes that lead deeper outwards, as no decay does, that the long law misses."""

_PER_BOUND, _PER_RANGE = 1.5, 3.0
"""Depth that is left at the anchor: sigma over its bound and over the range read."""

_HIDDEN = 3.0
"""Power with which it becomes unlikely that C grad h hides larger slopes from all of the anchor."""

_CLOSER, _CLOSINGS = 11, 3
"""Trials between the neighbours of the likeliest one, and how often."""

_SEARCHES = ((1, 0.5 * PIECES), (1, MOST_NOISES), (2, 0.5 * PIECES), (2, MOST_NOISES))
"""Column of the law and power of its misfit by which the likeliest trial is closed in on.

A minimum may be narrower than the first trials are apart, and another one wide and low."""

_RIDGE = 1e-10
"""Added to the products of terms, over their own squares: two terms may be the same on these nodes."""

_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Of x and y in the long law's polynomial."""

_ROUND = ((0, 0), (3, 5), (6, 6), (7, 7))
"""Terms of the long law whose halves, added up, are the round law's: x^2 + y^2 for these."""

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


class Prior(NamedTuple):
    """What is known of C without the laws.

    range_mm: of depth read. rest_mm: the anchor's depth / h. bound_mm: the same if it decays as 1 / r and C
    is 0; hidden_mm: what of it noise can hide; odds: logarithm, that it is at rest. floor_mm: least distance
    from the centre.
    """

    range_mm: float
    rest_mm: float
    bound_mm: float
    hidden_mm: float
    odds: float
    floor_mm: float


@numba.njit(cache=True, error_model="numpy")
def likelihoods(nodes: Nodes, quiet: Nodes, share: Float, prior: Prior, trial: Float) -> Float:
    """Rows (m, 5): C; misfit of the round and of the long law; logarithm of how likely C is without; noise.

    Noise is its share of the squares allowed. share: the weight of each of the anchor's nodes `quiet`.
    trial: C to begin with, mm; others follow where the laws fit best.
    """
    first = len(trial)
    seen = np.empty((first + _CLOSER * _CLOSINGS * len(_SEARCHES), 5))
    low = high = 0.0
    for count in range(len(seen)):
        place = (count - first) % _CLOSER
        if count < first:
            constant = trial[count]
        else:
            if place == 0:
                law, power = _SEARCHES[(count - first) // (_CLOSER * _CLOSINGS)]
                low, high = _about_best(seen[:count], law, power)
            constant = low + (high - low) * (place + 1) / (_CLOSER + 1)
        row = seen[count]
        row[0] = constant
        row[1], row[2], row[4], x, y = _misfits(nodes, constant)
        row[3] = _known(quiet, share, prior, constant, x, y)
    return seen


@numba.njit(cache=True, error_model="numpy")
def _about_best(seen: Float, law: int, power: float) -> tuple[float, float]:
    """The trials next to the likeliest one; itself where there is none."""
    best, most, low, high = 0.0, -np.inf, -np.inf, np.inf
    for i in range(len(seen)):
        likely = seen[i, 3] - power * np.log(seen[i, law])
        if likely > most:
            best, most = seen[i, 0], likely
    for i in range(len(seen)):
        if low < seen[i, 0] < best:
            low = seen[i, 0]
        if best < seen[i, 0] < high:
            high = seen[i, 0]
    return (low if low > -np.inf else best), (high if high < np.inf else best)


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _known(quiet: Nodes, share: Float, prior: Prior, constant: float, x_mm: float, y_mm: float) -> float:
    """Logarithm of how likely C is by what is left at the anchor, with the dent's centre at x, y."""
    bound2 = 0.0
    for i in range(len(share)):
        away2 = max((quiet.x[i] - x_mm) ** 2 + (quiet.y[i] - y_mm) ** 2, prior.floor_mm**2)
        slope_x = quiet.slope_x[i] - constant * quiet.gradient_x[i]
        slope_y = quiet.slope_y[i] - constant * quiet.gradient_y[i]
        slope2 = slope_x**2 + slope_y**2 - 2.0 * (quiet.variance_x[i] + quiet.variance_y[i])
        bound2 += share[i] * away2 * slope2 / quiet.scale[i] ** 2
    hidden_mm, left_mm = prior.hidden_mm, prior.rest_mm - constant
    quiet_mm = max(np.sqrt(max(bound2, 0.0)), hidden_mm)
    seen2 = (left_mm / (_PER_BOUND * prior.bound_mm)) ** 2
    hidden2 = (left_mm / (_PER_BOUND * quiet_mm)) ** 2
    seen = prior.odds - np.log(prior.bound_mm) - 2.0 * np.log1p(seen2 / 3.0)
    unseen = -np.log(hidden_mm) - 2.0 * np.log1p(hidden2 / 3.0) - _HIDDEN * np.log(quiet_mm / hidden_mm)
    either = max(seen, unseen) + np.log1p(np.exp(-abs(seen - unseen)))
    return float(either - np.log1p((left_mm / (_PER_RANGE * prior.range_mm)) ** 2))


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _misfits(nodes: Nodes, constant: float) -> tuple[float, float, float, float, float]:
    """Squares that the round law leaves, the long one, and noise, over those allowed; the centre, mm."""
    n = len(nodes.x)
    deepest = middle_x = middle_y = 0.0
    for i in range(n):
        deepest = max(deepest, abs(nodes.depth[i] - constant * nodes.scale[i]))
        middle_x += nodes.x[i] / n
        middle_y += nodes.y[i] / n
    x, y = centre(nodes, constant, _CORE_SHARE * deepest)
    if np.isnan(x):
        return _NO_CENTRE, _NO_CENTRE, 1.0, middle_x, middle_y
    gram, allowed, noise, deeper2 = _products(nodes, constant, deepest, x, y)
    by_long = max(_left(gram, 6), _OUTWARDS * deeper2) / allowed
    short = np.empty((4, 4))
    for i, (a, b) in enumerate(_ROUND):
        for j, (c, d) in enumerate(_ROUND):
            short[i, j] = gram[a, c] + gram[a, d] + gram[b, c] + gram[b, d]
    by_round = 0.25 * _left(short, 0) / allowed
    return max(by_round, _LEAST_MISFIT), max(by_long, _LEAST_MISFIT), noise / allowed, x, y


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
def _products(
    nodes: Nodes, constant: float, deepest: float, x_mm: float, y_mm: float
) -> tuple[Float, float, float, float]:
    """Weighted products (8, 8) of the long law's terms; squares allowed, of noise, and outwards deeper.

    Terms: depth times 1, x, y, x^2, x y, y^2; r . s times r^2, and r . s. x, y: from the centre.
    """
    n = len(nodes.x)
    depth2, mixed = np.empty(n), np.empty(n)
    total = noise = deeper2 = radial2 = flattened = flattened2 = 0.0
    for i in range(n):
        x, y = nodes.x[i] - x_mm, nodes.y[i] - y_mm
        depth = nodes.depth[i] - constant * nodes.scale[i]
        slope_x = nodes.slope_x[i] - constant * nodes.gradient_x[i]
        slope_y = nodes.slope_y[i] - constant * nodes.gradient_y[i]
        radial, square = x * slope_x + y * slope_y, x * x + y * y
        noise2 = nodes.variance_x[i] * (x * x) + nodes.variance_y[i] * (y * y)
        allowed = noise2 + (_SMALLEST * radial) ** 2
        # the core follows laws of its own
        weight = (1.02 - abs(depth) / deepest) ** 2 / (allowed + (_FLAT * depth) ** 2)
        total += weight * allowed
        noise += weight * noise2
        weighed2 = weight * radial * radial
        deeper2 += weighed2 if radial * depth > 0.0 else 0.0
        radial2 += weighed2
        flattened += weighed2 * square
        flattened2 += weighed2 * square * square
        depth2[i], mixed[i] = weight * depth * depth, weight * depth * radial
    among = _moments(depth2, nodes.x, nodes.y, x_mm, y_mm)
    across = _moments(mixed, nodes.x, nodes.y, x_mm, y_mm)
    gram = np.empty((8, 8))
    gram[6, 6], gram[6, 7], gram[7, 6], gram[7, 7] = flattened2, flattened, flattened, radial2
    for i, (a, b) in enumerate(_POWERS):
        for j, (c, d) in enumerate(_POWERS):
            gram[i, j] = among[a + c, b + d]
        gram[i, 6] = gram[6, i] = across[a + 2, b] + across[a, b + 2]
        gram[i, 7] = gram[7, i] = across[a, b]
    return gram, total, noise, deeper2


@numba.njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _moments(weight: Float, x_mm: Float, y_mm: Float, centre_x: float, centre_y: float) -> Float:
    """Sums (5, 5) of weight x^a y^b about the centre, a + b up to 4."""
    one = a = b = aa = ab = bb = aaa = aab = abb = bbb = aaaa = aaab = aabb = abbb = bbbb = 0.0
    for i in range(len(weight)):
        x, y, w = x_mm[i] - centre_x, y_mm[i] - centre_y, weight[i]
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


@numba.njit(cache=True, error_model="numpy")
def _left(gram: Float, free: int) -> float:
    """Least squares of the last term plus a sum of the others, by the products (p, p) of them all.

    The first `free` have factors of either sign, the rest never < 0.
    """
    count = len(gram)
    scaled, size = np.empty_like(gram), np.empty(count)
    for i in range(count):
        size[i] = np.sqrt(max(gram[i, i], 1e-300))
        for j in range(i + 1):
            scaled[i, j] = scaled[j, i] = gram[i, j] / (size[i] * size[j])
        scaled[i, i] += _RIDGE if i < count - 1 else 0.0
    for k in range(free):
        for i in range(k + 1, count):
            factor = scaled[i, k] / scaled[k, k]
            for j in range(k + 1, count):
                scaled[i, j] -= factor * scaled[k, j]
    rest, bounded = scaled[free:, free:], count - 1 - free
    least = min(rest[bounded, bounded], 1.0)
    # all subsets of the bounded terms, each from the last by one: the solution's is one of them
    for number in range(1, 1 << bounded):
        changed = 0
        while not number >> changed & 1:
            changed += 1
        _sweep(rest, changed)
        inside = True
        for k in range(bounded):
            inside &= rest[k, bounded] <= 0.0 or not (number ^ number >> 1) >> k & 1
        if inside:
            least = min(least, rest[bounded, bounded])
    return float(max(least, 1e-9) * size[-1] ** 2)


@numba.njit(cache=True, error_model="numpy")
def _sweep(gram: Float, k: int) -> None:
    """Solve for term k, or undo it: gram[-1, -1] is what those solved for leave of the last.

    And gram[k, -1] is the last one's share of k (J. H. Goodnight, A tutorial on the SWEEP operator, The
    American Statistician 33 (1979) 149, doi:10.1080/00031305.1979.10482685).
    """
    count, pivot = len(gram), gram[k, k]
    for j in range(count):
        gram[k, j] /= pivot
    for i in range(count):
        if i != k:
            factor = gram[i, k]
            for j in range(count):
                gram[i, j] -= factor * gram[k, j]
            gram[i, k] = -factor / pivot
    gram[k, k] = 1.0 / pivot
