"""Exact warps of planted dents, and the reader that has to return them."""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.special import i0e, i1e

from benchmarks.anchors import View
from benchmarks.dents import Planted, Sum, gauss, power
from zeromethod import Surface, Warp, binned, load_rig
from zeromethod.optics import Dented, DepthField
from zeromethod.rig.model import KnownRest, RestSurface, Rig, SurfaceSpec

Gauss = partial(Planted, gauss)
"""Of depth, x, y and sigma, mm: a formula, which no rubber makes."""


def _loaded(along, across):
    """exp(-u) I0(u), u = r^2 / 2: a half-space under a Gaussian pressure; Johnson 1985, 3."""
    u = 0.5 * (along**2 + across**2)
    depth, by_u = i0e(u), i1e(u) - i0e(u)
    return depth, by_u * along, by_u * across


Load = partial(Planted, _loaded)
"""The dent of a load: of depth, x, y and the sigma, mm, of the Gaussian that is as curved in its middle."""

Tail = partial(Planted, power(1.0))
"""What (r^2 + core^2)^(-3/2) of pressure makes, 1/sqrt(r^2 + core^2): of depth, x, y and core, mm."""

Several = Sum


@dataclass(frozen=True)
class Waves:
    """Crossed sines of one wavelength under a wide Gaussian, so that the border is at rest."""

    depth_mm: float
    x_mm: float
    y_mm: float
    wavelength_mm: float
    hull: Planted

    def _factors(self, x, y):
        k = 2 * np.pi / self.wavelength_mm
        return k, np.cos(k * (x - self.x_mm)), np.cos(k * (y - self.y_mm))

    def depth(self, x, y):
        _, a, b = self._factors(x, y)
        return self.depth_mm * a * b * self.hull.depth(x, y)

    def slope(self, x, y):
        k, a, b = self._factors(x, y)
        h, (hx, hy) = self.hull.depth(x, y), self.hull.slope(x, y)
        da, db = -k * np.sin(k * (x - self.x_mm)), -k * np.sin(k * (y - self.y_mm))
        return self.depth_mm * (da * b * h + a * b * hx), self.depth_mm * (a * db * h + a * b * hy)


class Bench(View):
    """One rig's optics, nodes and reader."""

    @property
    def centre_mm(self) -> float:
        return self.optics.length_mm / 2

    @cached_property
    def pitch_mm(self) -> float:
        """Of the nodes along the middle row of the mirror."""
        rest = self.optics.trace(*self.grid.mesh(), self.optics.rest)
        return float(np.nanmedian(np.diff(rest.point[self.grid.shape[0] // 2, :, 0])))

    def warp(self, dent: DepthField, draw: np.random.Generator | None = None) -> Warp:
        """The exact warp of a dent, with one frame's noise where a generator is given."""
        return replace(super().warp(dent, draw), time_ns=7)

    def truth(self, dent: DepthField) -> np.ndarray:
        """Planted depth at every node's own mirror point."""
        point = self.optics.trace(*self.grid.mesh(), Dented(self.optics.rest, dent)).point
        return dent.depth(point[..., 0], point[..., 1])

    def error(self, surface: Surface, dent: DepthField) -> np.ndarray:
        """Read minus planted depth at the valid nodes, flat."""
        return (surface.depth_mm - self.truth(dent))[surface.valid]

    def constant_and_shape(self, surface: Surface, dent: DepthField) -> tuple[float, np.ndarray]:
        """The same in two: the multiple of h that slopes leave open, mm, and the rest."""
        error, h = self.error(surface, dent), self.reader.scale[surface.valid[self.grid.inner]]
        constant = float((error * h).sum() / (h * h).sum())
        return constant, error - constant * h


def small_rig(rest: RestSurface | None = None, known_rest: tuple[KnownRest, ...] = ()) -> Rig:
    rig = binned(load_rig("simulated"), 4)
    prism = rig.prism if rest is None else rig.prism.model_copy(update={"rest": rest})
    return rig.model_copy(update={"prism": prism, "surface": SurfaceSpec(known_rest=known_rest)})
