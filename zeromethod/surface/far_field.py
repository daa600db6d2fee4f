"""Far field of a dent: its depth where the view ends, from how slope and depth decay together.

Depth D is read up to C h, and then slope with C grad h: every trial C gives another dent, d = D - C h with
slope s. About its centre r . s = -m d, with m how fast it decays: by a round law (n, k, g >= 0)

    m = (n + k r^2) / (1 + g r^2),

n = 1 alone is what any load leaves on a deep elastic body (Boussinesq; K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 3.2, doi:10.1017/CBO9781139171731), k alone a Gaussian, k = g a load of finite size on
that body; or by a long one, with a polynomial of second degree in x and y over 1 + g r^2: dents that are not
round, or whose centre is misjudged because the view cuts them. C is the likelier, the smaller the squares of
what the law leaves of r . s, relative to r . s itself; the centre, too, is that of the dent of each C.

Each law misses the true one by about as much in neighbouring nodes, so that all of them count as `_PIECES`
independent ones, and as fewer, the worse even the best C fits: a dent of no such shape is hardly judged by
its law. What remains is that depth falls at least about as 1 / r: with the slopes that C implies, which may
be hidden where C grad h cancels them, so that C is the less likely, the more of that it takes. An anchor
whose slopes are noise is at rest, unless the laws fit so much better with it deeper that this outweighs the
odds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask

_CORE_SHARE = 0.2
"""Depth over the largest at which the dent's core, which gives its centre, ends."""

_PARALLEL = 1e-3
_SMALLEST, _FLAT = 0.03, 0.01
"""Error of the law's slope that is allowed for at each node, over r . s and over depth."""

_PIECES, _MOST_NOISES = 12.0, 24.0
"""Independent errors of a law over the view, and most of the noise."""

_WELL = 2.0
"""Misfit over the allowed by which the pieces of a law that fits badly are divided."""

_LEAST_MISFIT = 0.3
_LONG_COST = 6.0
"""Logarithm of likelihood that the long law must gain for its six numbers."""

_OUTWARDS = 0.02
"""Share of the squares of slopes that lead deeper outwards, as no decay does, that the long law misses."""

_PER_BOUND, _PER_RANGE, _WIDEST = 1.5, 3.0, 6.0
"""Depth that is left at the anchor: sigma over its bound and over the range read, and most over the range."""

_HIDDEN = 3.0
"""Power with which it becomes unlikely that C grad h hides larger slopes from all of the anchor."""

_SEEN, _LEAST_SEEN = 0.5, 0.02
"""Odds, times range over what noise can hide, that a quiet anchor is at rest; its sigma over the hidden."""

_MOST_NODES, _LEAST_NODES = 400, 60
_TRIALS, _CLOSER, _CLOSINGS = 81, 11, 3
_NO_LAW = 2.0
"""Sigma over the bound where too few nodes are left for a law."""


@dataclass(frozen=True, slots=True)
class FarField:
    """Multiple C of h, mm, by which depth was read too deep, and its standard deviation."""

    constant_mm: float
    sigma_mm: float


@dataclass(frozen=True, slots=True)
class _Nodes:
    """Some nodes (n,): slope, variance, scale's gradient (n, 2), depth, scale, place."""

    slope: Float
    variance: Float
    gradient: Float
    depth: Float
    scale: Float
    x: Float
    y: Float


def fit_far_field(
    slope: Float,
    variance: Float,
    depth_mm: Float,
    scale: Float,
    scale_gradient: Float,
    x_mm: Float,
    y_mm: Float,
    island: Mask,
    weights: Float,
    bound_mm: float,
    hidden_mm: float,
    overlap: float,
) -> FarField:
    """C and its sigma by the laws of the module, as far as they fit, and by what decays at least as 1 / r.

    slope, variance, scale_gradient: (rows, cols, 2), rad, rad^2, 1/mm; depth_mm, scale, x_mm, y_mm: (rows,
    cols). weights: the anchor's, (rows, cols). bound_mm: its depth if it decays as 1 / r and C is 0, and
    hidden_mm: what of it noise can hide. overlap: number of nodes that share their noise.
    """
    fields = (slope, variance, scale_gradient, depth_mm, scale, x_mm, y_mm)
    nodes, quiet = (
        _Nodes(*(one[chosen] for one in fields)) for chosen in (_evenly(island), _evenly(weights > 0.0))
    )
    rest_mm = float((weights * depth_mm / scale)[weights > 0.0].sum())
    range_mm = float(np.max(np.abs(depth_mm - rest_mm * scale)[island]))
    if len(nodes.x) < _LEAST_NODES or not range_mm > 0.0:
        return FarField(0.0, _NO_LAW * bound_mm)
    share = weights[_evenly(weights > 0.0)]
    floor2 = (0.25**2) * (np.ptp(x_mm[island]) ** 2 + np.ptp(y_mm[island]) ** 2)

    hidden_mm, bound_mm = max(hidden_mm, bound_mm), max(bound_mm, _LEAST_SEEN * hidden_mm)
    odds = np.log1p(_SEEN * range_mm / hidden_mm) * (1.0 - bound_mm / hidden_mm)

    def look(trial: Float) -> Float:
        """Rows: C, misfit of both laws, how likely C is without them (logarithm), noise in the misfit."""
        misfits, noisy, centre = _misfits(nodes, trial)
        quiet_mm = np.maximum(_bound(quiet, share / share.sum(), trial, centre, floor2), hidden_mm)
        left_mm = rest_mm - trial
        seen = odds - np.log(bound_mm) - 2.0 * np.log1p((left_mm / (_PER_BOUND * bound_mm)) ** 2 / 3.0)
        unseen = -np.log(hidden_mm) - 2.0 * np.log1p((left_mm / (_PER_BOUND * quiet_mm)) ** 2 / 3.0)
        known = np.logaddexp(seen, unseen - _HIDDEN * np.log(quiet_mm / hidden_mm))
        known -= np.log1p((left_mm / (_PER_RANGE * range_mm)) ** 2)
        return np.stack([trial, *misfits, known, noisy])

    noises = min(len(nodes.x), np.count_nonzero(island) / overlap, _MOST_NOISES)
    wide = _WIDEST * range_mm * np.sinh(np.linspace(-4, 4, _TRIALS)) / np.sinh(4)
    near = np.minimum(bound_mm * np.geomspace(0.3, 100.0, 8), range_mm)
    return _weighed(look, noises, rest_mm + np.unique(np.concatenate([wide, near, -near])))


def _evenly(nodes: Mask) -> Mask:
    """An even lattice of at most about `_MOST_NODES` of the nodes (rows, cols)."""
    apart = max(1, int(np.ceil(np.sqrt(np.count_nonzero(nodes) / _MOST_NODES))))
    chosen = np.zeros_like(nodes)
    chosen[::apart, ::apart] = nodes[::apart, ::apart]
    return chosen if np.count_nonzero(chosen) >= _LEAST_NODES else nodes


def _weighed(look: Callable[[Float], Float], noises: float, trial: Float) -> FarField:
    """Mean and deviation of C over both laws, each as likely as it fits.

    noises: number of independent ones. trial: (m,) ascending C to begin with.
    """
    seen = look(trial)
    # a minimum may be narrower than the first trials are apart, and another one wide and low
    for law, power in itertools.product((1, 2), (0.5 * _PIECES, _MOST_NOISES)):
        for _ in range(_CLOSINGS):
            best = int(np.argmax(seen[3] - power * np.log(seen[law])))
            low, high = seen[0, max(best - 1, 0)], seen[0, min(best + 1, seen.shape[1] - 1)]
            more = look(np.linspace(low, high, _CLOSER + 2)[1:-1])
            seen = np.concatenate([seen, more], axis=1)
            seen = seen[:, np.argsort(seen[0])]
    constant, width = seen[0], np.gradient(seen[0])
    at = seen[1:3].argmin(axis=1)
    least, noisy = seen[1:3].min(axis=1), seen[4, at]
    pieces = 1.0 / ((1.0 - noisy) / _PIECES + noisy / max(noises, _PIECES))
    pieces /= 1.0 + np.maximum(least - noisy, 0.0) / _WELL
    likely = seen[3] - 0.5 * pieces[:, None] * np.log(seen[1:3] / least[:, None])
    share = width * np.exp(likely - likely.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    gained = 0.5 * _PIECES * float(np.log(least[0] / least[1])) - _LONG_COST
    long = 1.0 / (1.0 + np.exp(-np.clip(gained, -50.0, 50.0)))
    both = (1.0 - long) * share[0] + long * share[1]
    mean = float((both * constant).sum())
    return FarField(mean, float(np.sqrt((both * (constant - mean) ** 2).sum())))


def _bound(quiet: _Nodes, share: Float, trial: Float, centre: Float, floor2: float) -> Float:
    """Depth / h of the anchor's nodes (m,), mm, if it falls as 1 / r about each trial's centre (m, 2)."""
    away2 = (quiet.x - centre[:, :1]) ** 2 + (quiet.y - centre[:, 1:]) ** 2
    slope2 = ((quiet.slope - trial[:, None, None] * quiet.gradient) ** 2 - 2.0 * quiet.variance).sum(axis=-1)
    found = (share * np.maximum(away2, floor2) / quiet.scale**2 * slope2).sum(axis=-1)
    return np.asarray(np.sqrt(np.maximum(found, 0.0)), np.float64)


def _misfits(nodes: _Nodes, trial: Float) -> tuple[list[Float], Float, Float]:
    """Squares that the round and the long law leave at each trial C (m,), over the allowed.

    With the share of these that is noise (m,), and the centres (m, 2).
    """
    depth = nodes.depth - trial[:, None] * nodes.scale
    slope = nodes.slope - trial[:, None, None] * nodes.gradient
    size = np.abs(depth)
    size = size / size.max(axis=-1, keepdims=True)
    centre = centres(slope, nodes.x, nodes.y, size > _CORE_SHARE)
    found = np.isfinite(centre[:, 0])
    centre = np.where(found[:, None], centre, (nodes.x.mean(), nodes.y.mean()))
    x, y = (one - at[:, None] for one, at in zip((nodes.x, nodes.y), centre.T, strict=True))
    outward = x * slope[..., 0] + y * slope[..., 1]
    noise2 = nodes.variance[:, 0] * x * x + nodes.variance[:, 1] * y * y
    unit = np.sqrt(np.median(x * x + y * y, axis=-1, keepdims=True))
    x, y = x / unit, y / unit
    square = x * x + y * y
    allowed = noise2 + (_SMALLEST * outward) ** 2
    # the core follows laws of its own
    weight = (1.02 - size) ** 2 / (allowed + (_FLAT * depth) ** 2)
    total = (weight * allowed).sum(axis=-1)
    round_law = np.stack([outward, depth, square * depth, square * outward], axis=1)
    polynomial = [one * depth for one in (1.0, x, y, x * x, x * y, y * y)]
    long_law = np.stack([outward, *polynomial, square * outward], axis=1)
    grams = [(one * weight[:, None]) @ one.transpose(0, 2, 1) for one in (round_law, long_law)]
    deeper2 = (weight * np.where(outward * depth > 0.0, outward**2, 0.0)).sum(axis=-1)
    left = [_left(grams[0], free=0), np.maximum(_left(grams[1], free=6), _OUTWARDS * deeper2)]
    misfits = [np.where(found, np.maximum(one / total, _LEAST_MISFIT), 1e6) for one in left]
    return misfits, (weight * noise2).sum(axis=-1) / total, centre


def centres(slope: Float, x_mm: Float, y_mm: Float, core: Mask) -> Float:
    """Points (m, 2) that the core's lines of steepest descent pass closest to; NaN for parallel ones.

    slope: (m, n, 2); core: (m, n). Minimises sum |s x (p - c)|^2, which also works for a dent that is cut off
    by the view or has a hole.
    """
    sx, sy = (np.where(core, slope[..., k], 0.0) for k in (0, 1))
    cross = sx * y_mm - sy * x_mm
    a, b, c = ((one * other).sum(axis=-1) for one, other in ((sy, sy), (sx, sy), (sx, sx)))
    u, v = -(sy * cross).sum(axis=-1), (sx * cross).sum(axis=-1)
    determinant = a * c - b * b
    apart = determinant > _PARALLEL * (a + c) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.stack([c * u + b * v, b * u + a * v], axis=-1) / determinant[:, None]
    return np.where(apart[:, None], found, np.nan)


def _left(gram: Float, free: int) -> Float:
    """Least squares (m,) of column 0 plus a sum of the others, `free` of either sign, the rest never < 0.

    gram: (m, p, p) products of the columns.
    """
    size = np.sqrt(np.maximum(np.einsum("mii->mi", gram), 1e-300))
    gram = gram / size[:, :, None] / size[:, None, :]
    others = range(1 + free, gram.shape[1])
    best = np.ones(len(gram))
    for subset in range(2 ** len(others)):
        bounded = [k for place, k in enumerate(others) if subset >> place & 1]
        used = [*range(1, 1 + free), *bounded]
        if not used:
            continue
        part = gram[:, used][:, :, used] + 1e-10 * np.eye(len(used))
        solution = np.linalg.solve(part, -gram[:, used, 0, None])[..., 0]
        inside = (solution[:, free:] >= 0.0).all(axis=-1)
        left = 1.0 + (solution * gram[:, 0, used]).sum(axis=-1)
        best = np.where(inside, np.minimum(best, left), best)
    return np.asarray(np.maximum(best, 1e-9) * size[:, 0] ** 2, np.float64)
