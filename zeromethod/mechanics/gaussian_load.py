"""Dents that Gaussian pressures exp(-r^2 / 2 l^2) make on rubber, in closed form or by Hankel integrals.

A dent is 1 mm deep in its middle. On a half-space, with u = r^2 / 4 l^2,

    d = e^(-u) I0(u),    dd/dr = (I1(u) - I0(u)) e^(-u) r / 2 l^2,    q = l sqrt(2 / pi),

and d = q / r far away (F = pi E* q for each mm of depth, E* = E / (1 - nu^2)). A base under a layer and the
other faces of a prism add to that, per q. Source: Johnson 1985, Contact Mechanics, 3.4,
doi:10.1017/CBO9781139171731; Gradshteyn & Ryzhik, 6.618.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import i0e, i1e, j0, j1

from zeromethod.arrays import Float
from zeromethod.mechanics.body import BodyKernel
from zeromethod.mechanics.layer import reach_and_waves

_HERMITE = np.polynomial.hermite_e.hermegauss(3)
"""Points and weights by which what a prism adds is averaged over a pressure: exact to the fifth degree."""


@dataclass(frozen=True)
class Loads:
    """Gaussian pressures: places x, y (n,) and widths l (n,), mm."""

    x_mm: Float
    y_mm: Float
    width_mm: Float

    def __len__(self) -> int:
        return len(self.x_mm)

    def __getitem__(self, some: slice) -> Loads:
        return Loads(self.x_mm[some], self.y_mm[some], self.width_mm[some])

    @property
    def q_mm2(self) -> Float:
        """(n,) what depth far away is over 1 / distance, for dents 1 mm deep on a half-space."""
        return np.sqrt(2 / np.pi) * self.width_mm


@dataclass(frozen=True)
class HalfSpace:
    """Rubber so thick that its other faces do not matter."""

    def fields(self, x_mm: Float, y_mm: Float, loads: Loads) -> Float:
        """(3, places, loads): depth over mm of depth, and its slopes along x and y, 1/mm."""
        dx, dy = x_mm[:, None] - loads.x_mm, y_mm[:, None] - loads.y_mm
        l2 = loads.width_mm**2
        u = (dx**2 + dy**2) / (4 * l2)
        depth = i0e(u)
        by_r = (i1e(u) - depth) / (2 * l2)
        return np.stack([depth, by_r * dx, by_r * dy])


@dataclass(frozen=True)
class LayerBody:
    """A layer on a rigid base, bonded to it or sliding on it."""

    thickness_mm: float
    poisson: float
    bonded: bool

    def fields(self, x_mm: Float, y_mm: Float, loads: Loads) -> Float:
        """As `HalfSpace.fields`."""
        out = HalfSpace().fields(x_mm, y_mm, loads)
        for width in np.unique(loads.width_mm):
            mine = loads.width_mm == width
            dx, dy = x_mm[:, None] - loads.x_mm[mine], y_mm[:, None] - loads.y_mm[mine]
            r = np.hypot(dx, dy)
            at, depth, by_r = _added(self.thickness_mm, self.poisson, self.bonded, float(width))
            beyond = r > at[-1]  # there the base takes all of a half-space's dent
            slope = np.where(beyond, 0.0, np.interp(r, at, by_r))
            out[0][:, mine] = np.where(beyond, 0.0, out[0][:, mine] + np.interp(r, at, depth))
            out[1][:, mine] = np.where(beyond, 0.0, out[1][:, mine] + slope * dx)
            out[2][:, mine] = np.where(beyond, 0.0, out[2][:, mine] + slope * dy)
        return out


@dataclass(frozen=True, eq=False)
class PrismBody:
    """The rig's prism, with what holds its faces; share: of what they add."""

    kernel: BodyKernel
    share: float = 1.0

    def fields(self, x_mm: Float, y_mm: Float, loads: Loads) -> Float:
        """As `HalfSpace.fields`."""
        at, weight = _HERMITE
        x = (loads.x_mm[:, None, None] + loads.width_mm[:, None, None] * at[:, None]) + 0 * at
        y = (loads.y_mm[:, None, None] + loads.width_mm[:, None, None] * at) + 0 * at[:, None]
        by_load = self.kernel.by_loads(np.stack([x.ravel(), y.ravel()])).reshape(-1, *x.shape)
        share = np.outer(weight, weight) / weight.sum() ** 2
        mean = np.einsum("inab,ab->in", by_load, share) * (self.share * loads.q_mm2)
        added = np.einsum("kin,im->knm", self.kernel.products(x_mm, y_mm), mean, optimize=True)
        return HalfSpace().fields(x_mm, y_mm, loads) + added


Elastic = HalfSpace | LayerBody | PrismBody
"""How a body answers to loads on its mirror."""


@lru_cache(32)
def _added(thickness_mm: float, poisson: float, bonded: bool, width_mm: float) -> tuple[Float, Float, Float]:
    """(distance mm, depth, slope over distance 1/mm^2) that the base adds to a half-space's dent 1 mm deep."""
    reach, waves, lacks = reach_and_waves(thickness_mm, poisson, bonded)
    by = lacks * np.exp(-0.5 * (waves * width_mm) ** 2) * np.sqrt(2 / np.pi) * width_mm
    bessel0, bessel1 = _bessel(thickness_mm)
    return reach, bessel0 @ by, -(bessel1 @ (by * waves))


@lru_cache(2)
def _bessel(thickness_mm: float) -> tuple[Float, Float]:
    """J0(k r) and J1(k r) / r (reach, waves)."""
    reach, waves, _ = reach_and_waves(thickness_mm, 0.5, True)
    product = np.outer(reach, waves)
    over_r = j1(product) / np.maximum(reach, 1e-12)[:, None]
    over_r[0] = 0.5 * waves
    return j0(product), over_r
