"""Exact warps of planted dents, and the reader that has to return them."""

from dataclasses import dataclass

import numpy as np

from zeromethod import NodeGrid, Surface, SurfaceReader, Warp, binned, load_rig
from zeromethod.optics import Dented, DepthField, Optics
from zeromethod.rig.model import KnownRest, RestSurface, Rig, SurfaceSpec
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.overlap import component_correlation
from zeromethod.warp.validity import Flag

RESIDUAL_SIGMA_PX = 0.013
"""Noise of one frame's residual, camera px (2 grey levels in 8 bits)."""


@dataclass(frozen=True)
class Gauss:
    peak_mm: float
    x_mm: float
    y_mm: float
    sigma_mm: float

    def depth(self, x, y):
        r2 = (x - self.x_mm) ** 2 + (y - self.y_mm) ** 2
        return self.peak_mm * np.exp(-0.5 * r2 / self.sigma_mm**2)

    def slope(self, x, y):
        d = self.depth(x, y) / self.sigma_mm**2
        return -(x - self.x_mm) * d, -(y - self.y_mm) * d


@dataclass(frozen=True)
class Waves:
    """Crossed sines of one wavelength under a wide Gaussian, so that the border is at rest."""

    peak_mm: float
    x_mm: float
    y_mm: float
    wavelength_mm: float
    hull: Gauss

    def _factors(self, x, y):
        k = 2 * np.pi / self.wavelength_mm
        return k, np.cos(k * (x - self.x_mm)), np.cos(k * (y - self.y_mm))

    def depth(self, x, y):
        _, a, b = self._factors(x, y)
        return self.peak_mm * a * b * self.hull.depth(x, y)

    def slope(self, x, y):
        k, a, b = self._factors(x, y)
        h, (hx, hy) = self.hull.depth(x, y), self.hull.slope(x, y)
        da, db = -k * np.sin(k * (x - self.x_mm)), -k * np.sin(k * (y - self.y_mm))
        return self.peak_mm * (da * b * h + a * b * hx), self.peak_mm * (a * db * h + a * b * hy)


@dataclass(frozen=True)
class Tail:
    """The far field of a press on a deep elastic body: falls off like 1/r."""

    peak_mm: float
    x_mm: float
    y_mm: float
    core_mm: float

    def depth(self, x, y):
        r2 = (x - self.x_mm) ** 2 + (y - self.y_mm) ** 2 + self.core_mm**2
        return self.peak_mm * self.core_mm / np.sqrt(r2)

    def slope(self, x, y):
        r2 = (x - self.x_mm) ** 2 + (y - self.y_mm) ** 2 + self.core_mm**2
        factor = -self.peak_mm * self.core_mm * r2**-1.5
        return factor * (x - self.x_mm), factor * (y - self.y_mm)


@dataclass(frozen=True)
class Several:
    parts: tuple[DepthField, ...]

    def depth(self, x, y):
        return sum(part.depth(x, y) for part in self.parts)

    def slope(self, x, y):
        slopes = [part.slope(x, y) for part in self.parts]
        return sum(s[0] for s in slopes), sum(s[1] for s in slopes)


def _line(correlation: np.ndarray, nodes: int) -> np.ndarray:
    lag = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    return np.where(lag < len(correlation), correlation[np.minimum(lag, len(correlation) - 1)], 0.0)


def _root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T


class Bench:
    """One rig's optics, nodes and reader."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.optics = Optics(rig)
        self.grid = NodeGrid.of_rig(rig)
        self.reader = SurfaceReader(rig, self.optics, self.grid)
        self.centre_mm = self.optics.length_mm / 2
        u, v = self.grid.mesh()
        rest = self.optics.trace(u, v, self.optics.rest)
        roots = component_correlation(self.grid.period_px, self.grid.spacing_px, "cosines")
        own, other = ([_root(_line(c, n)) for c in roots] for n in (self.grid.shape[1], self.grid.shape[0]))
        self._roots = ((own[0], other[1]), (own[1], other[0]))
        middle = self.grid.shape[0] // 2
        self.pitch_mm = float(np.nanmedian(np.diff(rest.point[middle, :, 0])))

    def warp(self, dent: DepthField, generator: np.random.Generator | None = None) -> Warp:
        """The exact warp of a dent, with one frame's noise where a generator is given."""
        u, v = self.grid.mesh()
        trace = self.optics.trace(u, v, Dented(self.optics.rest, dent))
        flags = np.full(self.grid.shape, Flag.OUTSIDE, np.uint16)
        flags[self.grid.inner] = 0
        flags[~trace.reaches_display] |= np.uint16(Flag.NO_RAY)
        q, bending = trace.q, jacobian(trace.q, self.grid.spacing_px)
        sigma = RESIDUAL_SIGMA_PX * np.linalg.norm(bending, axis=-1)
        if generator is not None:
            white = generator.standard_normal((2, *self.grid.shape))
            noise = [down @ e @ across for e, (across, down) in zip(white, self._roots, strict=True)]
            q = q + RESIDUAL_SIGMA_PX * np.einsum("...ij,j...->...i", bending, np.stack(noise))
        return Warp(q, np.where(np.isfinite(sigma), sigma, 1.0), flags, time_ns=7)

    def truth(self, dent: DepthField) -> np.ndarray:
        """Planted depth at every node's own mirror point."""
        u, v = self.grid.mesh()
        point = self.optics.trace(u, v, Dented(self.optics.rest, dent)).point
        return dent.depth(point[..., 0], point[..., 1])

    def error(self, surface: Surface, dent: DepthField) -> np.ndarray:
        """Read minus planted depth at the valid nodes, flat."""
        return (surface.depth_mm - self.truth(dent))[surface.valid]


def small_rig(rest: RestSurface | None = None, known_rest: tuple[KnownRest, ...] = ()) -> Rig:
    rig = binned(load_rig("simulated"), 4)
    prism = rig.prism if rest is None else rig.prism.model_copy(update={"rest": rest})
    return rig.model_copy(update={"prism": prism, "surface": SurfaceSpec(known_rest=known_rest)})
