"""Measured warp to surface: intersect, bisect, integrate, anchor, and again, because the mirror moved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.surface.anchor import RestFit, fit_known, fit_quiet, known_nodes
from zeromethod.surface.bridge import Lattice, bridge, cut_off_islands
from zeromethod.surface.covariance import DepthCovariance
from zeromethod.surface.far_field import fit_far_field
from zeromethod.surface.integrate import LinearIntegration, SlopeIntegrator, largest_island
from zeromethod.surface.lever import Lever
from zeromethod.surface.noise import DepthNoise, SlopeNoise
from zeromethod.surface.rays import MirrorRays
from zeromethod.surface.surface import Anchor, Surface
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.overlap import component_correlation, overlap_correlation
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_MAX_ITERATIONS = 14
_SETTLED_MM = 1e-7
_ANCHOR_ITERATIONS = 3
_ANCHOR_MOVED_MM = 1e-3
"""The anchor's nodes are chosen anew this often at most, and only after depth moved by more than this; then
they are kept, so that the passes converge."""
_NEARLY_MM = 1e-5
"""Depth that still moves by less is good enough to tell the far field's tail by."""
_MOST_TAILS = 3
_CLOSER = 0.3
_UNLAWFUL = 2.0
_PROBE_DEPTH_MM = 1e-3

T = TypeVar("T", bound=np.generic)


@dataclass(slots=True)
class _Reading:
    """Depth (rows, cols) in mm, 0 off the island, with the slope and points it came from."""

    depth: Float
    slope: Float
    point: Float
    fit: RestFit | None
    iterations: int


@dataclass(frozen=True, slots=True)
class _Last:
    """What the covariance of the surface last read is made of."""

    surface: Surface
    linear: LinearIntegration
    noise: SlopeNoise
    fit: RestFit


class SurfaceReader:
    """Reads slope and depth of the mirror off measured warps.

    A node's depth d belongs to its own mirror point, where its ray meets z = h_rest(x, y) - d. From there
    the ray to the LCD position is solved through all layers; the bisector of the two rays is the normal.
    The slopes are integrated by weighted least squares with a high-order rule, the depth anchored where the
    rubber is at rest, and all of it repeated until depth settles within 0.1 nm.

    A warp's sigma is taken to come from the residual: displacements along u and v, independent of each other
    and correlated between nodes by their windows' overlap, which the warp itself turns and stretches.

    Keeps factors, weights and noise samples between frames; they change speed, never what is read beyond
    the noise's own weighting.
    """

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid) -> None:
        """Fix the rays of `grid`'s measurable nodes. Raises InputError when none sees the LCD at rest."""
        self._grid = grid
        self._known_rest = rig.surface.known_rest
        u, v = grid.mesh()
        u, v = u[grid.inner], v[grid.inner]
        self._rays = MirrorRays(optics, u, v)
        seen = largest_island(self._rays.seen)
        if np.count_nonzero(seen) < 4:
            raise InputError(f"rig {rig.name}: no camera pixel sees the LCD by the mirror at rest")
        rest = np.zeros(u.shape)
        slope, point = self._rays.slope(rest, self._rays.rest_q)
        self._rest_point = point
        sensitivity = optics.sensitivity(u, v)
        regular = seen & (np.abs(np.linalg.det(np.where(seen[..., None, None], sensitivity, np.eye(2)))) > 0)
        self._seen = regular
        sensitivity = np.where(regular[..., None, None], sensitivity, np.eye(2))
        self._rest_bending = jacobian(self._rays.rest_q, grid.spacing_px)
        self._lever = Lever(self._rays, sensitivity)
        self._scale = self._depth_scale(slope, point)
        self._integrator = SlopeIntegrator(point[..., 0], point[..., 1], self._scale)
        self._correlation = overlap_correlation(grid.period_px, grid.spacing_px)
        self._overlap = component_correlation(grid.period_px, grid.spacing_px, rig.target.kind)
        self._noise = DepthNoise(self._integrator)
        self._last: _Last | None = None

    def _depth_scale(self, slope: Float, point: Float) -> Float:
        """Integrate K = d(slope)/d(depth) at fixed q: h (rows, cols), 1 at its median."""
        deeper, _ = self._rays.slope(np.full(slope.shape[:-1], _PROBE_DEPTH_MM), self._rays.rest_q)
        rate = (deeper - slope) / _PROBE_DEPTH_MM
        usable = self._seen & np.isfinite(rate).all(axis=-1)
        plain = SlopeIntegrator(point[..., 0], point[..., 1])
        plain.prepare(usable, np.ones((*usable.shape, 2)))
        kappa = plain.integrate(rate, point[..., 0], point[..., 1])
        kappa -= np.median(kappa[plain.island])
        scale = np.where(plain.island, np.exp(kappa), 1.0)
        self._scale_gradient = np.where(usable[..., None], rate, 0.0) * scale[..., None]
        return scale

    @property
    def scale(self) -> Float:
        """Scale h (rows, cols) of the measurable nodes, median 1: slopes fix depth up to a multiple of it.

        A constant error of depth moves the mirror along its rays and so changes the slopes read; h is the
        depth that goes unnoticed, about proportional to the mirror's distance from the LCD.
        """
        return self._scale

    def read(self, warp: Warp, previous: Surface | None = None) -> Surface:
        """Slope and depth from a measured warp on the reader's grid.

        previous: a surface read shortly before, to start from; it saves passes and does not change the result
        beyond 0.1 nm, or beyond the anchor's sigma where a far field is followed. Raises InputError on a warp
        of another shape. Nodes that are flagged, see nothing at rest, or are cut off from the largest
        connected part of the others come out NaN.
        """
        if warp.q.shape != (*self._grid.shape, 2):
            raise InputError(f"warp.q: shape {warp.q.shape}: must be {(*self._grid.shape, 2)}")
        inner = self._grid.inner
        sigma_q, q = warp.sigma[inner], warp.q[inner]
        with np.errstate(invalid="ignore"):
            usable = (warp.flags[inner] == 0) & self._seen & (sigma_q > 0.0).all(axis=-1)
        usable &= np.isfinite(q).all(axis=-1) & np.isfinite(sigma_q).all(axis=-1)
        q = np.where(usable[..., None], q, np.nan)
        bending = jacobian(warp.q, self._grid.spacing_px)[inner]
        known = np.isfinite(bending).all(axis=(-1, -2), keepdims=True)
        bending = np.where(known, bending, self._rest_bending)
        flat, at_rest = np.zeros(usable.shape), np.zeros((*usable.shape, 2))
        variance = (self._lever.factor(flat, at_rest, bending, sigma_q) ** 2).sum(axis=-1)
        start = flat if previous is None else np.nan_to_num(previous.depth_mm[inner])
        tail_mm = 0.0 if previous is None else previous.anchor.tail_mm
        reading = self._settle(q, variance, usable, start, tail_mm)
        factor = self._lever.factor(reading.depth, reading.slope, bending, sigma_q)
        surface = self._surface(warp, reading, SlopeNoise(factor, *self._overlap))
        return self._with_beyond(surface, reading, q, usable, factor)

    def covariance(self, surface: Surface) -> DepthCovariance:
        """Full covariance of the depths of the surface that this reader read last.

        It stays valid when the reader goes on. Raises InputError for another surface or one without depth.
        """
        last = self._last
        if last is None or last.surface is not surface:
            raise InputError("surface: not the one last read, or nothing was read: read it, then ask")
        scale, fit = self._scale, last.fit
        return DepthCovariance(self._grid, last.linear, last.noise, scale, fit.weights, fit.sigma_mm)

    def _settle(self, q: Float, variance: Float, usable: Mask, depth: Float, tail_mm: float) -> _Reading:
        integrator, scale = self._integrator, self._scale
        slope, point = np.full((*usable.shape, 2), np.nan), self._rest_point
        island = integrator.prepare(usable, variance)
        fit: RestFit | None = None
        moved, tails, bound_mm = np.inf, 0, 0.0
        for iteration in range(1, _MAX_ITERATIONS + 1):
            slope, point = self._rays.slope(depth, q)
            readable = island & np.isfinite(slope).all(axis=-1)
            if np.count_nonzero(readable) != np.count_nonzero(island):
                island = integrator.prepare(readable, variance)
            if not island.any():
                return _Reading(np.zeros_like(depth), slope, point, None, iteration)
            depth = np.where(island, depth, 0.0)
            new = depth + scale * integrator.integrate(slope, point[..., 0], point[..., 1], depth)
            if fit is None or (moved > _ANCHOR_MOVED_MM and iteration <= _ANCHOR_ITERATIONS):
                fit = self._fit(slope, variance, new, point, island)
                fit = replace(fit, tail_mm=tail_mm if fit.sigma_mm > 0.0 else 0.0)
            new -= scale * (float((fit.weights * new / scale).sum()) - fit.tail_mm)
            new = np.where(island, new, 0.0)
            moved = float(np.max(np.abs(new - depth)))
            depth = new
            if tails < _MOST_TAILS and moved < _NEARLY_MM:
                before, bound_mm = fit.tail_mm, bound_mm * _CLOSER if tails else fit.sigma_mm
                fit = self._with_tail(fit, slope, variance, depth, point, island, bound_mm)
                step = fit.tail_mm - before
                depth = np.where(island, depth + scale * step, 0.0)
                moved = max(moved, abs(step))
                tails = tails + 1 if abs(step) > fit.sigma_mm else _MOST_TAILS
            if moved < _SETTLED_MM:
                break
        return _Reading(depth, slope, point, fit, iteration)

    def _fit(self, slope: Float, variance: Float, depth: Float, point: Float, island: Mask) -> RestFit:
        x, y = point[..., 0], point[..., 1]
        known = known_nodes(self._known_rest, x, y) & island
        if known.any():
            return fit_known(known, self._scale)
        return fit_quiet(slope, variance, depth, self._scale, x, y, island, self._correlation)

    def _with_tail(
        self,
        fit: RestFit,
        slope: Float,
        variance: Float,
        depth: Float,
        point: Float,
        island: Mask,
        bound_mm: float,
    ) -> RestFit:
        """The same nodes, with the tail's depth there where the far field tells it better than the bound.

        Told again after it was taken off: a tail of 0.1 mm moves the mirror enough to be told 1 % wrong.
        Where the far field follows no law the bound, which takes it to fall off all the way, is doubled.
        """
        if fit.sigma_mm == 0.0:
            return fit
        x, y = point[..., 0], point[..., 1]
        # Windows overlap alike on both axes.
        overlap = (2.0 * float(self._correlation.sum()) - 1.0) ** 2
        found = fit_far_field(
            slope, variance, depth, self._scale, self._scale_gradient, x, y, island, bound_mm, overlap
        )
        first = bound_mm == fit.sigma_mm
        if first and (found is None or found.sigma_mm > bound_mm):
            return replace(fit, tail_mm=0.0, sigma_mm=_UNLAWFUL * bound_mm)
        if found is None:
            return fit
        return replace(fit, tail_mm=fit.tail_mm - found.constant_mm, sigma_mm=found.sigma_mm)

    def _surface(self, warp: Warp, reading: _Reading, noise: SlopeNoise) -> Surface:
        island = self._integrator.island
        off = ~island
        mask = np.zeros(island.shape, bool)
        sigma_depth = np.full(island.shape, np.nan)
        anchor = Anchor("none", self._padded(mask, False), 0.0)
        fit = reading.fit
        if fit is not None:
            x, y = reading.point[..., 0], reading.point[..., 1]
            of_frame = self._noise.sigma(noise, x, y, fit.weights)
            sigma_depth = self._scale * np.hypot(of_frame, fit.sigma_mm)
            typical = fit.sigma_mm * float(np.sqrt(np.mean(self._scale[island] ** 2)))
            anchor = Anchor(fit.mode, self._padded(fit.weights > 0.0, False), typical, fit.tail_mm)
        contact = (warp.flags & Flag.LIGHT_LOST != 0) & (warp.flags & (Flag.OUTSIDE | Flag.NO_RAY) == 0)
        surface = Surface(
            depth_mm=self._padded(np.where(off, np.nan, reading.depth), np.nan),
            slope=self._padded(np.where(off[..., None], np.nan, reading.slope), np.nan),
            x_mm=self._padded(reading.point[..., 0], np.nan),
            y_mm=self._padded(reading.point[..., 1], np.nan),
            sigma_depth_mm=self._padded(sigma_depth, np.nan),
            sigma_slope=self._padded(np.where(off[..., None], np.nan, np.sqrt(noise.variance)), np.nan),
            valid=self._padded(island, False),
            contact=contact,
            anchor=anchor,
            time_ns=warp.time_ns,
            iterations=reading.iterations,
        )
        self._last = None
        if fit is not None:
            x, y = reading.point[..., 0], reading.point[..., 1]
            self._last = _Last(surface, self._integrator.linear(x, y), noise, fit)
        return surface

    def _with_beyond(
        self, surface: Surface, reading: _Reading, q: Float, usable: Mask, factor: Float
    ) -> Surface:
        """The surface with what is tied to it over gaps; the same one where there is nothing."""
        island = self._integrator.island
        others = cut_off_islands(usable, island) if island.any() else []
        variance = (factor**2).sum(axis=-1)
        read = Lattice(reading.depth, reading.slope, reading.point)
        found = bridge(self._rays, q, variance, self._scale, island, others, read) if others else None
        if found is None:
            return surface
        off = ~found.nodes
        # Noise over a gap adds little to that of the nodes before it.
        noise = float(np.nanmax(surface.sigma_depth_mm))
        beyond = replace(
            surface,
            depth_mm=self._padded(np.where(off, np.nan, found.read.depth), np.nan),
            slope=self._padded(np.where(off[..., None], np.nan, found.read.slope), np.nan),
            x_mm=self._padded(found.read.point[..., 0], np.nan),
            y_mm=self._padded(found.read.point[..., 1], np.nan),
            sigma_depth_mm=self._padded(np.where(off, np.nan, np.hypot(noise, found.sigma_mm)), np.nan),
            sigma_slope=self._padded(np.where(off[..., None], np.nan, np.sqrt(variance)), np.nan),
            valid=self._padded(found.nodes, False),
        )
        whole = replace(surface, beyond=beyond)
        if self._last is not None:
            self._last = replace(self._last, surface=whole)
        return whole

    def _padded(self, inner: NDArray[T], fill: float | bool) -> NDArray[T]:
        full = np.full((*self._grid.shape, *inner.shape[2:]), fill, dtype=inner.dtype)
        full[self._grid.inner] = inner
        return full
