"""Dents that Gaussian pressures exp(-r^2 / 2 l^2) make on rubber, in closed form or by Hankel integrals.

A dent is 1 mm deep in its middle. On a half-space, with u = r^2 / 4 l^2,

    d = e^(-u) I0(u),    dd/dr = (I1(u) - I0(u)) e^(-u) r / 2 l^2,    q = l sqrt(2 / pi),

and d = q / r far away (F = pi E* q for each mm of depth, E* = E / (1 - nu^2)). A base under a layer and the
other faces of a prism add to that, per q. Source: Johnson 1985, Contact Mechanics, 3.4,
doi:10.1017/CBO9781139171731; Gradshteyn & Ryzhik, 6.618.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import i0e, i1e, j0, j1

from zeromethod.arrays import Float, Ints, Single
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
        return np.asarray(np.sqrt(2 / np.pi) * self.width_mm)


Fields = Callable[[Loads], Single]
"""Of loads: (3, places, loads) depth at places, and its slopes along x and y, 1/mm, per mm of depth."""


@dataclass(frozen=True)
class HalfSpace:
    """Rubber so thick that its other faces do not matter."""

    def profile(self, distance_mm: Float, width_mm: float) -> tuple[Float, Float]:
        """Depth of a dent 1 mm deep, and its slope over distance, 1/mm^2, at distances (n,)."""
        u = (distance_mm / width_mm) ** 2 / 4
        depth = i0e(u)
        return depth, (i1e(u) - depth) / (2 * width_mm**2)

    def at(self, x_mm: Float, y_mm: Float) -> Fields:
        """Fields at places (n,)."""
        return radial_fields(self.profile, x_mm, y_mm)


@dataclass(frozen=True)
class LayerBody:
    """A layer on a rigid base, bonded to it or sliding on it."""

    thickness_mm: float
    poisson: float
    bonded: bool

    def profile(self, distance_mm: Float, width_mm: float) -> tuple[Float, Float]:
        """Depth of a dent that is 1 mm deep on a half-space, and its slope over distance, 1/mm^2."""
        depth, slope = HalfSpace().profile(distance_mm, width_mm)
        at, added, by_r = _added(self.thickness_mm, self.poisson, self.bonded, width_mm)
        # beyond the table the base takes all of a half-space's dent
        there = distance_mm <= at[-1]
        depth = np.where(there, depth + np.interp(distance_mm, at, added), 0.0)
        return depth, np.where(there, slope + np.interp(distance_mm, at, by_r), 0.0)

    def at(self, x_mm: Float, y_mm: Float) -> Fields:
        """Fields at places (n,)."""
        return radial_fields(self.profile, x_mm, y_mm)


@dataclass(frozen=True, eq=False)
class PrismBody:
    """The rig's prism, with what holds its faces; share: of what they add."""

    kernel: BodyKernel
    share: float = 1.0

    def at(self, x_mm: Float, y_mm: Float) -> Fields:
        """Fields at places (n,)."""
        free, products = HalfSpace().at(x_mm, y_mm), np.float32(self.kernel.products(x_mm, y_mm))
        at, weight = _HERMITE
        across, along = (one.ravel() for one in np.meshgrid(at, at))
        share = np.outer(weight, weight).ravel() / weight.sum() ** 2

        def fields(loads: Loads) -> Single:
            spread = [
                np.add.outer(np.zeros(9), middle) + np.outer(by, loads.width_mm)
                for middle, by in ((loads.x_mm, along), (loads.y_mm, across))
            ]
            by_load = self.kernel.by_loads(np.stack([one.ravel() for one in spread]))
            mean = np.einsum("ikn,k->in", by_load.reshape(len(by_load), 9, -1), share)
            added = np.asarray(self.share * mean * loads.q_mm2, np.float32)
            return np.asarray(free(loads) + np.einsum("kin,im->knm", products, added, optimize=True))

        return fields


Elastic = HalfSpace | LayerBody | PrismBody
"""How a body answers to loads on its mirror."""


Profile = Callable[[Float, float], tuple[Float, Float]]
"""Of distances, mm, and a width, mm: depth, and slope over distance, 1/mm^2."""


def radial_fields(profile: Profile, x_mm: Float, y_mm: Float) -> Fields:
    """Fields of round dents at places (n,), by tables of their profile, to 1e-5 of the deepest."""
    x, y = np.asarray(x_mm, np.float32)[:, None], np.asarray(y_mm, np.float32)[:, None]

    def fields(loads: Loads) -> Single:
        out = np.empty((3, len(x), len(loads)), np.float32)
        for width in np.unique(loads.width_mm):
            mine = loads.width_mm == width
            dx, dy = x - np.float32(loads.x_mm[mine]), y - np.float32(loads.y_mm[mine])
            place = np.sqrt(dx * dx + dy * dy) * np.float32(1.0 / (_STEP * width))
            at = place.astype(np.int32)
            share = place - at
            table = profile(_STEP * width * np.arange(int(at.max()) + 2), float(width))
            depth, by_r = (_between(np.asarray(one, np.float32), at, share) for one in table)
            out[:, :, mine] = np.stack([depth, by_r * dx, by_r * dy])
        return out

    return fields


def _between(table: Single, at: Ints, share: Single) -> Single:
    return np.asarray(table[at] + share * np.diff(table)[at])


_STEP = 0.02
"""Between distances of a table, over the width."""


@lru_cache(32)
def _added(thickness_mm: float, poisson: float, bonded: bool, width_mm: float) -> tuple[Float, Float, Float]:
    """(distance mm, depth, slope / distance 1/mm^2) that the base adds to a half-space's dent 1 mm deep."""
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
