"""Far field of a dent: its depth where the view ends, from how slope and depth decay together.

Depth D is read up to C h, and then slope with C grad h: every trial C gives another dent, d = D - C h with
slope s. About its centre r . s = -m d, with m how fast it decays: by a round law (n, k, g >= 0)

    m = (n + k r^2) / (1 + g r^2),

n = 1 alone is what any load leaves on a deep elastic body (Boussinesq; K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 3.2, doi:10.1017/CBO9781139171731), k alone a Gaussian, k = g a load of finite size on
that body; or by a long one, with a polynomial of second degree in x and y over 1 + g r^2: dents that are not
round, or whose centre is misjudged because the view cuts them. C is the likelier, the smaller the squares of
what the law leaves of r . s, relative to r . s itself; the centre, too, is that of the dent of each C.

Each law misses the true one by about as much in neighbouring nodes, so that all of them count as `PIECES`
independent ones, and as fewer, the worse even the best C fits: a dent of no such shape is hardly judged by
its law. What remains is that depth falls at least about as 1 / r: with the slopes that C implies, which may
be hidden where C grad h cancels them, so that C is the less likely, the more of that it takes. An anchor
whose slopes are noise is at rest, unless the laws fit so much better with it deeper that this outweighs the
odds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.surface.far_field_laws import MOST_NOISES, PIECES, Nodes, Prior, likelihoods

_WELL = 2.0
"""Misfit over the allowed by which the pieces of a law that fits badly are divided."""

_LONG_COST = 6.0
"""Logarithm of likelihood that the long law must gain for its six numbers."""

_SEEN, _LEAST_SEEN = 0.5, 0.02
"""Odds, times range over what noise can hide, that a quiet anchor is at rest; its sigma over the hidden."""

_NO_LAW = 2.0
"""Sigma over the bound where too few nodes are left for a law."""

_MOST_NODES, _LEAST_NODES = 400, 60
"""Nodes that are looked at, as more cost time and say nothing new, and that a law needs."""

_TRIALS, _WIDEST = 81, 6.0
"""Trials of C to begin with, and the largest over the range read."""


@dataclass(frozen=True, slots=True)
class FarField:
    """Multiple C of h, mm, by which depth was read too deep, and its standard deviation."""

    constant_mm: float
    sigma_mm: float


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
    anchor = weights > 0.0
    rest_mm = float((weights[anchor] * depth_mm[anchor] / scale[anchor]).sum())
    range_mm = float(np.max(np.abs(depth_mm - rest_mm * scale)[island]))
    seen, quiet = _evenly(island), _evenly(anchor)
    if len(seen[0]) < _LEAST_NODES or not range_mm > 0.0:
        return FarField(0.0, _NO_LAW * bound_mm)
    hidden_mm, bound_mm = max(hidden_mm, bound_mm), max(bound_mm, _LEAST_SEEN * hidden_mm)
    odds = float(np.log1p(_SEEN * range_mm / hidden_mm)) * (1.0 - bound_mm / hidden_mm)
    floor_mm = 0.25 * float(np.hypot(np.ptp(x_mm[island]), np.ptp(y_mm[island])))
    prior = Prior(range_mm, rest_mm, bound_mm, hidden_mm, odds, floor_mm)
    nodes, still = (
        Nodes(
            *(field[*at, axis] for field in (slope, variance, scale_gradient) for axis in (0, 1)),
            *(field[at] for field in (depth_mm, scale, x_mm, y_mm)),
        )
        for at in (seen, quiet)
    )
    share = weights[quiet]
    wide = _WIDEST * range_mm * np.sinh(np.linspace(-4, 4, _TRIALS)) / np.sinh(4)
    near = np.minimum(bound_mm * np.geomspace(0.3, 100.0, 8), range_mm)
    trial = rest_mm + np.concatenate([wide, near, -near])
    noises = min(len(nodes.x), np.count_nonzero(island) / overlap, MOST_NOISES)
    return _weighed(likelihoods(nodes, still, share / share.sum(), prior, trial), noises)


def _evenly(nodes: Mask) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of an even lattice of at most about `_MOST_NODES` of the nodes (rows, cols)."""
    apart = max(1, int(np.ceil(np.sqrt(np.count_nonzero(nodes) / _MOST_NODES))))
    rows, columns = np.nonzero(nodes[::apart, ::apart])
    return (apart * rows, apart * columns) if len(rows) >= _LEAST_NODES else np.nonzero(nodes)


def _weighed(seen: Float, noises: float) -> FarField:
    """Mean and deviation of C over both laws, each as likely as it fits.

    seen: (m, 5) `likelihoods`. noises: number of independent ones.
    """
    constant, *misfits, known, noise = seen[np.unique(seen[:, 0], return_index=True)[1]].T
    misfit = np.stack(misfits)
    at = misfit.argmin(axis=1)
    least, noisy = misfit.min(axis=1), noise[at]
    pieces = 1.0 / ((1.0 - noisy) / PIECES + noisy / max(noises, PIECES))
    pieces /= 1.0 + np.maximum(least - noisy, 0.0) / _WELL
    likely = known - 0.5 * pieces[:, None] * np.log(misfit / least[:, None])
    share = np.gradient(constant) * np.exp(likely - likely.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    gained = 0.5 * PIECES * float(np.log(least[0] / least[1])) - _LONG_COST
    long = 1.0 / (1.0 + np.exp(-np.clip(gained, -50.0, 50.0)))
    both = (1.0 - long) * share[0] + long * share[1]
    mean = float((both * constant).sum())
    return FarField(mean, float(np.sqrt((both * (constant - mean) ** 2).sum())))
