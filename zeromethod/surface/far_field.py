"""Far field of a dent: its depth where the view ends, from how slope and depth decay together.

Depth D is read up to C h, and then slope with C grad h, of which C is to be found. The dent d = D - C h is
one, or up to four at once, of any depth, place, size, length and sign, of a law each:

    d = A (1 + k z)^(-1 / (2 k)),    0 <= k <= 1,    z a quadratic form of the way from its centre,

k = 1 falls as 1 / r, as any load on a deep elastic body does (Boussinesq; K. L. Johnson, Contact Mechanics,
Cambridge 1985, section 3.2, doi:10.1017/CBO9781139171731), and nothing falls more slowly; k = 0 is a
Gaussian; between them are other powers of r. Besides, d = A exp(1 - sqrt(1 + z)): a layer on a stiff ground,
where depth decays exponentially. Where the rig says what holds its rubber's faces, a load's dent, k = 1, has
any share of what the body adds to it (`zeromethod.mechanics`), counted as k = 1 to 2. A load as wide as the
dent itself has the shape that a ball's pressure makes (Johnson, section 4.2): in the view it is much like a
power of r that falls faster, beyond it falls as 1 / r; around a dark contact it is much like a load's. Two
dents are two loads, or one with the bulge that rubber raises around it; they obey one law, as they press one
material, or each its own, as what presses differs: laws of another kind, which no fit leads to, are tried for
each. More are tried while they explain what is left.

Their numbers are fitted to the slopes, and C with them: at the anchor they must leave what is read there.
What a law leaves is noise and an error of its own, relative to the slopes, of unknown size, which is fitted
as well. Errors of a law are much the same in neighbouring nodes: all of them count as some independent ones,
as more where they are noise. The core, where loads lie and no law holds, counts little. As wrong as a law is
of slopes, it is of the anchor's depth, relative to what its slopes imply if depth falls as 1 / r; and of one
that explains little, all dents may fall so from where they are steepest. Every law is as likely as it makes
the slopes, each number that it needs a cost; the largest k, 1 and 0 count apart from the k that fits best.
A dent on a tilted mirror is one more explanation: a camera or an LCD that moved under a press looks like
that. C is the mean over all, and its sigma contains what they disagree by. What further dents noise may hide
in what is left (`weak_dents`) is added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.mechanics.body import BodyKernel
from zeromethod.surface.far_field_laws import Body, Known, Nodes, chosen
from zeromethod.surface.far_field_posterior import posterior
from zeromethod.surface.far_field_shapes import POINT
from zeromethod.surface.far_field_starts import FREE_LAW, centre
from zeromethod.surface.node_passes import diagonal

_NO_LAW = 2.0
"""Sigma over the bound where too few nodes are left for a law."""

_NODES, _QUIET_NODES, _LEAST_NODES = 300, 60, 60
"""Nodes that are looked at, all and of the anchor, as more say little new; and least."""

_BOTTOM = 1.02
"""Depth over the largest at which a node would have no weight."""

_CORE_SHARE = 0.2
"""Depth over the largest at which the dent's core, which gives its centre, ends."""

_NEAR = 0.3
"""Way beyond the view, over its diagonal, up to which a centre is taken."""


_NO_BODY = Body(np.zeros((0, 1, 1)), np.array([[0.0, 1.0], [0.0, 1.0]]), POINT)


@dataclass(frozen=True, slots=True)
class BodyOnNodes:
    """How the whole body answers loads: `body`, and its products (3, products, rows, cols) at nodes."""

    body: Body
    products: Float

    @classmethod
    def of(cls, kernel: BodyKernel, x_mm: Float, y_mm: Float) -> BodyOnNodes:
        """At nodes (rows, cols)."""
        products = kernel.products(x_mm, y_mm)
        return cls(Body(kernel.of_loads, kernel.load_box_mm, 2.0 * POINT), products)

    @classmethod
    def none(cls) -> BodyOnNodes:
        """Nothing: loads press a half-space."""
        return cls(_NO_BODY, np.zeros((3, 0, 0, 0)))


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
    of_body: BodyOnNodes | None = None,
    several: bool = True,
) -> FarField:
    """C and its sigma by the laws of the module, as far as they fit.

    slope, variance, scale_gradient: (rows, cols, 2), rad, rad^2, 1/mm; depth_mm, scale, x_mm, y_mm: (rows,
    cols). weights: the anchor's, (rows, cols). bound_mm: its depth if it decays as 1 / r and C is 0, and
    hidden_mm: what of it noise can hide. several: whether several dents are tried, too.
    """
    anchor = weights > 0.0
    lattice = slope, variance, scale_gradient, depth_mm, scale, x_mm, y_mm
    of_body = BodyOnNodes.none() if of_body is None else of_body
    quiet = _evenly(anchor, _QUIET_NODES)
    nodes = chosen(lattice, of_body.products, *_evenly(island, _NODES))
    still = chosen(lattice, of_body.products, *quiet)
    share = weights[quiet] / weights[quiet].sum()
    rest_mm = float(share @ (still.depth / still.scale))
    pressed = nodes.depth - rest_mm * nodes.scale
    range_mm = float(np.max(np.abs(pressed)))
    if len(pressed) < _LEAST_NODES or not range_mm > 0.0:
        return FarField(0.0, _NO_LAW * max(bound_mm, hidden_mm))
    known = Known((_BOTTOM - np.abs(pressed) / range_mm) ** 2, share, rest_mm, of_body.body)
    diagonal_mm = diagonal(x_mm, y_mm, island)
    # less the anchor's depth, and with it: where the scale differs much, that is another dent
    starts = np.stack(
        [_start(nodes, *less, diagonal_mm) for less in ((pressed, rest_mm), (nodes.depth, 0.0))]
    )
    return FarField(*posterior(nodes, still, known, starts, range_mm, diagonal_mm, several))


def _start(nodes: Nodes, pressed: Float, rest_mm: float, diagonal_mm: float) -> Float:
    """Numbers of a round dent to start from: where the core's lines meet, as wide as it is steep."""
    deepest = int(np.argmax(np.abs(pressed)))
    range_mm = float(abs(pressed[deepest]))
    x, y = centre(nodes, rest_mm, _CORE_SHARE * range_mm)
    low, high = (nodes.x.min(), nodes.y.min()), (nodes.x.max(), nodes.y.max())
    # False for NaN, too
    if not max(low[0] - x, x - high[0], low[1] - y, y - high[1]) < _NEAR * diagonal_mm:
        x, y = float(nodes.x[deepest]), float(nodes.y[deepest])
    slope_x, slope_y = nodes.slope_x - rest_mm * nodes.gradient_x, nodes.slope_y - rest_mm * nodes.gradient_y
    steepest = float(np.sqrt(np.max(slope_x**2 + slope_y**2)))
    # of a Gaussian
    size_mm = min(max(np.exp(-0.5) * range_mm / steepest, 0.01 * diagonal_mm), diagonal_mm)
    outwards = float((nodes.x - x) @ slope_x + (nodes.y - y) @ slope_y)
    return np.array([-np.copysign(range_mm, outwards), x, y, 1.0 / size_mm, 0.0, 1.0 / size_mm, FREE_LAW])


def _evenly(nodes: Mask, most: int) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of an even lattice of at most about so many of the nodes (rows, cols)."""
    apart = max(1, int(np.ceil(np.sqrt(np.count_nonzero(nodes) / most))))
    rows, columns = np.nonzero(nodes[::apart, ::apart])
    return (apart * rows, apart * columns) if 3 * len(rows) >= most else np.nonzero(nodes)
