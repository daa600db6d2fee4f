"""Far field of a dent: its depth where the view ends, from how slope and depth decay together.

Depth D is read up to C h, and then slope with C grad h: every trial C gives another dent, d = D - C h with
slope s. About its centre r . s = -m d, with m how fast it decays: by a round law (n, k, g >= 0)

    m = (n + k r^2) / (1 + g r^2),    or with the root of the denominator,

n = 1 alone is what any load leaves on a deep elastic body (Boussinesq; K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 3.2, doi:10.1017/CBO9781139171731), k alone a Gaussian, k = g a load of finite size on
that body, the root a layer on a stiff ground, where depth decays exponentially; or by a long one, with a
polynomial of second degree in x and y over 1 + g r^2: dents that are not round, or whose centre is misjudged
because the view cuts them. Each law counts with members of many sizes g, so that the rest of it is linear.

C is as likely as it makes the slopes. What a law leaves is noise and an error of its own, relative to r . s,
of unknown size, which is fitted: so a C whose slopes are larger, or whose centre is far, has no advantage by
that. Errors of a law are much the same in neighbouring nodes: all of them count as some independent ones, as
more where they are noise, and as fewer, the worse even the best C fits. On top comes what is known without
laws. Depth falls at least about as 1 / r: with the slopes that C implies, which may be hidden where C grad h
cancels them, so that C is the less likely, the more of that it takes. An anchor whose slopes are noise is
probably at rest. Numbers that are not physics were fitted to
how well C was known in the dents of seeds 0 and 1 of `benchmarks.anchors`, eleven of its sixteen families.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.surface.far_field_laws import Nodes
from zeromethod.surface.far_field_posterior import Prior, posterior
from zeromethod.surface.node_passes import diagonal

_NO_LAW = 2.0
"""Sigma over the bound where too few nodes are left for a law."""

_MOST_NODES, _LEAST_NODES = 400, 60
"""Nodes that are looked at, as more cost time and say nothing new, and that a law needs."""

_TRIALS, _WIDEST = 61, 6.0
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
) -> FarField:
    """C and its sigma by the laws of the module, as far as they fit, and by what decays at least as 1 / r.

    slope, variance, scale_gradient: (rows, cols, 2), rad, rad^2, 1/mm; depth_mm, scale, x_mm, y_mm: (rows,
    cols). weights: the anchor's, (rows, cols). bound_mm: its depth if it decays as 1 / r and C is 0, and
    hidden_mm: what of it noise can hide.
    """
    anchor = weights > 0.0
    rest_mm = float((weights[anchor] * depth_mm[anchor] / scale[anchor]).sum())
    range_mm = float(np.max(np.abs(depth_mm - rest_mm * scale)[island]))
    seen, quiet = _evenly(island), _evenly(anchor)
    if len(seen[0]) < _LEAST_NODES or not range_mm > 0.0:
        return FarField(0.0, _NO_LAW * bound_mm)
    prior = Prior(range_mm, rest_mm, bound_mm, hidden_mm, diagonal(x_mm, y_mm, island))
    nodes, still = (
        Nodes(
            *(field[*at, axis] for field in (slope, variance, scale_gradient) for axis in (0, 1)),
            *(field[at] for field in (depth_mm, scale, x_mm, y_mm)),
        )
        for at in (seen, quiet)
    )
    share = weights[quiet]
    wide = _WIDEST * range_mm * np.sinh(np.linspace(-4, 4, _TRIALS)) / np.sinh(4)
    near = np.minimum(max(bound_mm, hidden_mm) * np.geomspace(0.01, 100.0, 10), range_mm)
    trial = rest_mm + np.concatenate([wide, near, -near])
    return FarField(*posterior(nodes, still, share / share.sum(), prior, trial))


def _evenly(nodes: Mask) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of an even lattice of at most about `_MOST_NODES` of the nodes (rows, cols)."""
    apart = max(1, int(np.ceil(np.sqrt(np.count_nonzero(nodes) / _MOST_NODES))))
    rows, columns = np.nonzero(nodes[::apart, ::apart])
    return (apart * rows, apart * columns) if len(rows) >= _LEAST_NODES else np.nonzero(nodes)
