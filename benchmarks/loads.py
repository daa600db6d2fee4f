"""Loads as no reading has them: pressures of many shapes on a half-space, a bonded layer or a prism.

A pressure of Hankel transform P(k), P(0) = 1, and force F makes the dent

    d(r) = q integral of P(k) s(k T) J0(k r) dk,   q = F (1 - nu^2) / (pi E),

q / r far away on a half-space (s = 1); s is what a layer of thickness T yields, over a half-space. That
share and what a prism adds are the simulated bench's. Nothing here is of `zeromethod.mechanics`, by which
depth is read. Source: Johnson 1985, Contact Mechanics, 3 to 5, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf, pi, sqrt

import numpy as np
from scipy.interpolate import BSpline, RectBivariateSpline, make_interp_spline
from scipy.special import j0, jv

from zeromethod.arrays import Float
from zeromethod.rig.model import Rig
from zeromethod.rig.tables import FaceSupports
from zeromethod.simulation.contact.compliance import layer_factor
from zeromethod.simulation.elements.prism import HeldPrism, PrismKernel, prism_kernel

POISSON = 0.49
"""Of the rubber, as in the packaged rig file."""

HELD = FaceSupports(pattern="bonded", camera="bonded", ends="free")
"""What holds the prism."""


@dataclass(frozen=True)
class Pressure:
    """Transform of a pressure of radius 1, the radius of one as broad as a Gaussian, and a blur of its rim.

    radius: over the width of the Gaussian of the same mean square radius. blur: sigma of the Gaussian that
    takes sharp rims off, over the radius.
    """

    transform: Callable[[Float], Float]
    radius: float
    blur: float


PRESSURES = {
    "gaussian": Pressure(np.ones_like, 1.0, 1.0),
    "ball": Pressure(lambda k: 3 * (np.sin(k) - k * np.cos(k)) / k**3, sqrt(5), 0.05),
    "parabola": Pressure(lambda k: 8 * jv(2, k) / k**2, sqrt(6), 0.05),
    "cone": Pressure(lambda k: 2 * (1 - np.cos(k)) / k**2, sqrt(6), 0.15),
    "punch": Pressure(lambda k: np.sinc(k / pi), sqrt(3), 0.2),
    "ring": Pressure(j0, sqrt(2), 0.3),
}
"""Hertz's 1 - r^2 to the power of 1/2, its square, a cone's arcosh 1/r, a flat punch's, a wire ring's."""

_SMALL = 1e-12
"""Of a transform, and of what a layer lacks, is left out."""
_FAR = 20.0
"""Radii from which 1/r and its next term, 1/r^3, are all: 0.1 nm of 0.3 mm are left out."""


def _waves(most: float, longest: float) -> tuple[Float, Float]:
    """(nodes, weights) from 0 to `most` for waves up to a distance of `longest`: Gauss, one panel a wave."""
    at, weight = np.polynomial.legendre.leggauss(16)
    panels = int(most * longest / (2 * pi)) + 8
    step = most / panels
    return step * (np.arange(panels)[:, None] + 0.5 * (at + 1)).ravel(), np.tile(0.5 * step * weight, panels)


@lru_cache
def _half_space(kind: str) -> tuple[BSpline, float]:
    """Depth over q / radius by distance over radius up to `_FAR`, and the factor of 1/r^3 beyond."""
    pressure = PRESSURES[kind]
    reach = np.concatenate((np.arange(0.0, 3.0, 0.01), np.linspace(3.0, _FAR, 300)))
    k, weight = _waves(sqrt(-2 * np.log(_SMALL)) / pressure.blur, _FAR)
    weight = weight * pressure.transform(k) * np.exp(-0.5 * (pressure.blur * k) ** 2)
    broad = 0.5 / pressure.radius**2 + (0.5 * pressure.blur**2 if kind != "gaussian" else 0.0)
    return make_interp_spline(reach, j0(np.outer(reach, k)) @ weight, k=5), broad


@lru_cache(64)
def _layer_lacks(kind: str, width_mm: float, thickness_mm: float) -> BSpline:
    """What a layer adds to a half-space's depth per q, 1/mm, by distance up to 150 mm."""
    pressure = PRESSURES[kind]
    reach = np.linspace(0.0, 150.0, 600)
    k, weight = _waves(-0.6 * np.log(_SMALL) / thickness_mm, reach[-1])
    y = k * width_mm * pressure.radius
    lacks = layer_factor(k * thickness_mm, POISSON, bonded=True) - 1
    weight = weight * lacks * pressure.transform(y) * np.exp(-0.5 * (pressure.blur * y) ** 2)
    return make_interp_spline(reach, j0(np.outer(reach, k)) @ weight, k=5)


@dataclass(frozen=True)
class Load:
    """One load: a kind of `PRESSURES`, its q, mm^2, its place, and the width of a Gaussian as broad, mm."""

    kind: str
    q_mm2: float
    x_mm: float
    y_mm: float
    width_mm: float

    def field(self, x: Float, y: Float, thickness_mm: float) -> tuple[Float, Float, Float]:
        """Depth, mm, and its slopes along x and y, on a half-space or a layer."""
        x, y = x - self.x_mm, y - self.y_mm
        r = np.hypot(x, y)
        radius_mm = self.width_mm * PRESSURES[self.kind].radius
        near, broad = _half_space(self.kind)
        t = np.maximum(r / radius_mm, 1e-9)
        far, t_near = t > _FAR, np.minimum(t, _FAR)
        depth = np.where(far, 1 / t + broad / t**3, near(t_near)) / radius_mm
        by_r = np.where(far, -1 / t**2 - 3 * broad / t**4, near(t_near, 1)) / radius_mm**2
        if thickness_mm < inf:
            lacks = _layer_lacks(self.kind, self.width_mm, thickness_mm)
            depth, by_r = depth + lacks(r), by_r + lacks(r, 1)
        over_r = self.q_mm2 * by_r / np.maximum(r, 1e-9)
        return self.q_mm2 * depth, over_r * x, over_r * y


@dataclass(frozen=True, eq=False)
class Pressed:
    """Loads at once on a half-space, on a layer of some thickness, or on a prism; all times `scale`."""

    loads: tuple[Load, ...]
    thickness_mm: float = inf
    prism: PrismKernel | None = None
    scale: float = 1.0

    def depth(self, x: Float, y: Float) -> Float:
        """Depth at a place, mm."""
        added = 0.0 if self._added is None else self._added(x, y, grid=False)
        return np.asarray(self.scale * (added + np.sum(self._fields(x, y, 0), axis=0)))

    def slope(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Its slopes along x and y."""
        by_x, by_y = (np.sum(self._fields(x, y, part), axis=0) for part in (1, 2))
        if self._added is not None:
            by_x = by_x + self._added(x, y, dx=1, grid=False)
            by_y = by_y + self._added(x, y, dy=1, grid=False)
        return self.scale * by_x, self.scale * by_y

    def _fields(self, x: Float, y: Float, part: int) -> list[Float]:
        return [load.field(x, y, self.thickness_mm)[part] for load in self.loads]

    @cached_property
    def _added(self) -> RectBivariateSpline | None:
        """What the prism adds, by (x, y); a load counts as four points of its mean square radius."""
        if self.prism is None:
            return None
        x = np.linspace(0.0, self.prism.length_mm, 80)
        y = np.linspace(-self.prism.half_width_mm, self.prism.half_width_mm, 62)
        places = np.stack([each.ravel() for each in np.meshgrid(x, y, indexing="ij")])
        away = sqrt(2) * np.array([[1, -1, 0, 0], [0, 0, 1, -1]])
        points = [np.array([[one.x_mm], [one.y_mm]]) + one.width_mm * away for one in self.loads]
        force_n = np.repeat([pi * one.q_mm2 / (1 - POISSON**2) / 4 for one in self.loads], 4)
        depth = self.prism.between(places, np.concatenate(points, axis=1)) @ force_n
        return RectBivariateSpline(x, y, depth.reshape(len(x), len(y)), kx=5, ky=5, s=0)


def held_prism(rig: Rig) -> PrismKernel:
    """What the rig's prism, held at its faces, adds."""
    return prism_kernel(HeldPrism.of(rig.prism, HELD, POISSON))


def rough(
    draw: np.random.Generator, q_mm2: float, x_mm: float, y_mm: float, width_mm: float
) -> tuple[Load, ...]:
    """A load of eight narrow Gaussians, as broad together."""
    share = draw.uniform(0.2, 1.0, 8)
    away = 0.8 * width_mm * draw.standard_normal((8, 2))
    return tuple(
        Load("gaussian", float(q_mm2 * part / share.sum()), x_mm + float(x), y_mm + float(y), 0.6 * width_mm)
        for part, (x, y) in zip(share, away, strict=True)
    )
