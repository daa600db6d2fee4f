"""Surface reader: measured warp to slope and depth, by iterated intersection, bisection and integration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.errors import InputError
from zeromethod.mechanics.bodies import candidates_of
from zeromethod.optics import Optics
from zeromethod.optics.bench import sensitivity_of_rays
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig, check_rig
from zeromethod.surface.anchor import NodeReadings, RestFit
from zeromethod.surface.bench_drift import BenchDrift
from zeromethod.surface.bridge import ReadNodes, bridge, cut_off_parts
from zeromethod.surface.constant import LoadConstant
from zeromethod.surface.covariance import DepthCovariance
from zeromethod.surface.depth_scale import depth_scale
from zeromethod.surface.hidden import HiddenDepth
from zeromethod.surface.holes import fold_per_mm
from zeromethod.surface.integrate import LinearIntegration, SlopeIntegrator, largest_island
from zeromethod.surface.kept_constant import KeptConstant
from zeromethod.surface.learned import Learned
from zeromethod.surface.lever import Lever
from zeromethod.surface.node_passes import (
    at_rest_where_unknown,
    dot,
    moved_on,
    surface_arrays,
    together,
    use_nodes,
)
from zeromethod.surface.noise import DepthNoise, SlopeNoise
from zeromethod.surface.rays import MirrorRays
from zeromethod.surface.seams import PASSES, Carried, SlopeOverSeams
from zeromethod.surface.settling import Reading, Settling
from zeromethod.surface.surface import Anchor, Surface, continued_points
from zeromethod.surface.view_border import border_sigma_mm
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.overlap import component_correlation, overlap_correlation
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_MOST_AHEAD = 3
"""Steps like the last one by which a motion is continued at most."""


@dataclass(frozen=True, slots=True)
class _Last:
    """The last surface read, with the inputs of its covariance."""

    surface: Surface
    linear: LinearIntegration
    noise: SlopeNoise
    fit: RestFit
    systematic: list[Float]


class SurfaceReader:
    """Reader of the mirror's slope and depth from measured warps.

    Keeps lattices, weights, noise samples and the last surfaces between frames; they affect speed, and the
    reading only by the weighting of noise.

    Parameters
    ----------
    rig : Rig
        Names where the mirror is known to be at rest, and the target.
    optics : Optics
        Rays of the rig.
    grid : NodeGrid
        Nodes of the warps; the rays of its measurable nodes are traced once.
    with_sigma : bool
        Without, sigma is NaN, and neither loads nor a bench that moved are looked for: depth's constant is
        that of the loads that another reader learned. For whoever asks many candidate rigs for depths alone.

    Raises
    ------
    InputError
        When no node sees the LCD by the mirror at rest.

    Notes
    -----
    A node's depth d belongs to its own mirror point, where its ray meets z = h_rest(x, y) - d. From there
    the ray to the LCD position is solved through all layers; the bisector of the two rays is the normal.
    The slopes are integrated by weighted least squares with a high-order rule, depth gets its constant from
    the loads that explain them or where the rubber is known to be at rest, and all of it is repeated until
    depth settles within 0.1 nm.

    A warp's sigma is assumed to come from the residual: displacements along u and v, independent of each
    other and correlated between nodes by the overlap of their windows, which the warp itself turns and
    stretches.
    """

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid, with_sigma: bool = True) -> None:
        check_rig("SurfaceReader", rig)
        self._grid = grid
        u, v = grid.mesh()
        u, v = u[grid.inner], v[grid.inner]
        self._seams = SlopeOverSeams.of(optics, grid)
        self._rays = MirrorRays(optics, u, v, 0.0 if self._seams is None else self._seams.shift_mm)
        island = largest_island(self._rays.hits)
        if np.count_nonzero(island) < 4:
            raise InputError(f"rig {rig.name}: no camera pixel sees the LCD by the mirror at rest")
        rest = np.zeros(u.shape)
        slope, point = self._rays.slope(rest, self._rays.rest_q)
        self._rest_point = point
        self._rest_xy = continued_points(self._grid.padded(point[..., :2], np.nan))
        # at the rest's points, as they bend over centimetres, and depth moves a point by less than one of mm
        modes = rig.geometry.fields(self._rest_xy[..., 0], self._rest_xy[..., 1])
        self._depth_modes = modes[:, 0][(slice(None), *grid.inner)]
        self._depth_share = np.sqrt((self._depth_modes**2).sum(axis=0))
        self._sigma_place = np.sqrt((modes[:, 1:] ** 2).sum(axis=0))
        sensitivity = sensitivity_of_rays(optics, *self._rays.rubber)
        regular = island & (
            np.abs(np.linalg.det(np.where(island[..., None, None], sensitivity, np.eye(2)))) > 0
        )
        self._usable = regular
        sensitivity = np.where(regular[..., None, None], sensitivity, np.eye(2))
        if self._seams is not None:
            self._seams.set_rays(self._rays, sensitivity)
        self._rest_bending = jacobian(self._rays.rest_q, grid.spacing_px)
        self._fold_per_mm = fold_per_mm(self._rest_bending, grid.spacing_px, sensitivity, point, regular)
        self._lever = Lever(self._rays, sensitivity)
        self._scale, self._scale_gradient = depth_scale(self._rays, regular, slope, point)
        self._by_constant = grid.padded(self._scale_gradient, 0.0)
        self._integrator = SlopeIntegrator(point[..., 0], point[..., 1], self._scale)
        correlation = overlap_correlation(grid.period_px, grid.spacing_px)
        shape = self._scale, self._scale_gradient, regular, correlation
        bodies = candidates_of(rig) if with_sigma else ()
        x, y = np.moveaxis(continued_points(point[..., :2]), -1, 0)
        self._constant = KeptConstant(LoadConstant(bodies, x, y, *shape))
        known_rest = rig.surface.known_rest
        self._settling = Settling(self._rays, self._integrator, self._scale, known_rest, self._constant)
        self._overlap = component_correlation(grid.period_px, grid.spacing_px, rig.target.kind)
        self._noise = DepthNoise(self._integrator)
        self._drift: BenchDrift | None = None
        if with_sigma:
            at_rest = None if self._seams is None else self._seams.at_rest
            fixed = self._integrator, self._scale_gradient, at_rest
            self._drift = BenchDrift(rig, optics, grid, self._rays.rest_q, regular, sensitivity, *fixed)
        self._hidden = HiddenDepth(grid, sensitivity, point[..., 0], point[..., 1])
        self._left_open: tuple[GeometrySpec, Float] | None = None
        self._last: _Last | None = None
        self._before: tuple[Surface | None, Surface | None] = None, None

    @property
    def lever(self) -> Lever:
        """Lever of the measurable nodes."""
        return self._lever

    @property
    def scale(self) -> Float:
        """Scale h (rows, cols) of the measurable nodes, median 1: slopes fix depth up to a multiple of it.

        A constant error of depth moves the mirror along its rays and so changes the slopes; h is the error of
        depth that changes none of them, about proportional to the mirror's distance from the LCD.
        """
        return self._scale

    @property
    def learned(self) -> Learned | None:
        """Which loads were learned to press; None before the first reading, and where none are looked for."""
        return self._constant.learned

    def read(self, warp: Warp, previous: Surface | None = None, learned: Learned | None = None) -> Surface:
        """Slope and depth from a measured warp.

        Parameters
        ----------
        warp : Warp
            On the reader's grid.
        previous : Surface, optional
            A surface read shortly before, to start from: saves passes, and keeps which loads were learned to
            press; these are learned anew beside the readings that follow.
        learned : Learned, optional
            What another reader of the same lattice learned of this press (`SurfaceReader.learned`), to be
            kept.

        Returns
        -------
        Surface
            NaN at nodes that are flagged, see nothing at rest, or lie off the largest connected part.

        Raises
        ------
        InputError
            For a warp of another shape.
        """
        if warp.q.shape != (*self._grid.shape, 2):
            raise InputError(f"warp.q: shape {warp.q.shape}: must be {(*self._grid.shape, 2)}")
        if self._drift is not None:
            self._drift.look(warp)
        start = None if previous is None else self._start(warp.time_ns, previous)
        follows = previous is not None and self._last is not None and self._last.surface is previous
        self._constant.begin(follows, warp.time_ns, learned)
        inner, measured, seam, depth = self._grid.inner, warp, None, np.zeros(self._usable.shape)
        for last in [True] if self._seams is None else PASSES:
            if self._seams is not None:
                warp = (seam := self._seams.carried(measured, depth)).warp
            sigma_q, usable = warp.sigma[inner].copy(), np.empty_like(self._usable)
            planes = np.empty((2, *usable.shape))
            use_nodes(warp.q[inner], sigma_q, warp.flags[inner], self._usable, planes, usable)
            q = np.moveaxis(planes, 0, -1)
            bending = jacobian(warp.q, self._grid.spacing_px, PADDING)
            at_rest_where_unknown(bending, self._rest_bending)
            spread = self._lever.spread(bending, sigma_q)
            reading = self._settling.settle(q, self._lever.variance(spread), usable, start, last)
            depth = reading.depth
            start = np.where(self._integrator.island, depth, np.nan)
        variance = self._lever.variance(spread, reading.depth, reading.slope)
        factor = partial(self._lever.factor, bending, sigma_q, reading.depth, reading.slope)
        noise = SlopeNoise(factor, variance, *self._overlap)
        surface = self._surface(warp, reading, noise, previous is None, seam)
        return self._with_cut_off(surface, reading, q, usable, variance)

    def follow(self, warp: Warp) -> Surface:
        """`read` a warp that comes next: starting from the last surface, if there is one.

        The same warps in the same order give the same surfaces, bit for bit.

        Parameters
        ----------
        warp : Warp
            On the reader's grid.

        Returns
        -------
        Surface
            As `read`.

        Raises
        ------
        InputError
            For a warp of another shape.
        """
        return self.read(warp, None if self._last is None else self._last.surface)

    def covariance(self, surface: Surface) -> DepthCovariance:
        """Full covariance of the depths of the last surface read; it stays valid after further readings.

        Raises
        ------
        InputError
            For another surface, or one without depth.
        """
        last = self._last
        if last is None or last.surface is not surface:
            raise InputError("surface: not the one last read, or without depth; read it first")
        modes = self._depth_modes * np.where(last.linear.island, surface.depth_mm[self._grid.inner], 0.0)
        systematic = np.stack(last.systematic)
        return DepthCovariance(
            self._grid, last.linear, last.noise, self._scale, last.fit.weights, systematic, modes
        )

    def _start(self, time_ns: int, previous: Surface) -> Float:
        """The previous depth, moved on as it moved before.

        Only a surface that is the last one read is known to have moved.
        """
        inner = self._grid.inner
        depth = previous.depth_mm[inner].copy()
        before, earlier = self._before
        if (
            self._last is not None
            and self._last.surface is previous
            and before is not None
            and earlier is not None
        ):
            apart_ns, ahead_ns = previous.time_ns - before.time_ns, time_ns - previous.time_ns
            back_ns = before.time_ns - earlier.time_ns
            if back_ns > 0 and 0 < ahead_ns <= _MOST_AHEAD * apart_ns:
                steps = before.depth_mm[inner], earlier.depth_mm[inner]
                moved_on(depth, *steps, apart_ns / back_ns, ahead_ns / apart_ns)
        return depth

    def _surface(
        self, warp: Warp, reading: Reading, noise: SlopeNoise, alone: bool, seam: Carried | None
    ) -> Surface:
        """alone: sigma is to be as exact as it can be, and not only after some readings."""
        island = self._integrator.island
        sigma_depth = np.full(island.shape, np.nan)
        anchor = Anchor("none", np.zeros(self._grid.shape, bool), 0.0)
        x, y = reading.point[..., 0], reading.point[..., 1]
        fit, curl, systematic = reading.fit, None, list[Float]()
        if fit is not None and self._drift is not None:
            of_frame = self._noise.variance(noise, x, y, fit.weights, alone)
            read = NodeReadings(x, y, reading.depth, self._scale, of_frame, reading.slope, noise.variance)
            nodes = None if seam is None else seam.nodes[self._grid.inner]
            fit, systematic = self._drift.systematic(fit, read, noise, nodes)
            systematic.append(border_sigma_mm(reading.slope, reading.point, island))
            by = reading.depth, self._integrator.linear(x, y), fit.weights, self._scale
            systematic += [] if seam is None else seam.errors_mm(*by)
            hidden = None if warp.left is None else self._hidden.of(warp.left, noise.variance, island)
            systematic += [] if hidden is None else [hidden]
            systematic += self._left_open_mm(warp.left_open, reading, island)
            errors = self._depth_share, reading.depth, np.stack(systematic)
            sigma_depth = together(self._scale, of_frame, *errors)
            curl = self._drift.test(warp, reading, noise)
        if fit is not None:
            typical = fit.sigma_mm * float(np.sqrt(dot(self._scale**2, island) / np.count_nonzero(island)))
            mask = self._grid.padded(fit.weights > 0.0, False)
            learned = self._constant.learned if fit.mode == "loads" else None
            by_loads = (0, None) if learned is None else (learned.from_ns, learned.outside)
            anchor = Anchor(fit.mode, mask, typical, fit.far_field_mm, *by_loads)
        read_nodes = ReadNodes(reading.depth, reading.slope, reading.point)
        contact = warp.flags & (Flag.LIGHT_LOST | Flag.OUTSIDE | Flag.NO_RAY) == Flag.LIGHT_LOST
        surface = Surface(
            **self._arrays(island, read_nodes, sigma_depth, noise.variance),
            valid=self._grid.padded(island, False),
            contact=contact,
            anchor=anchor,
            time_ns=warp.time_ns,
            iterations=reading.iterations,
            curl=curl,
            fold_per_mm=self._fold_per_mm,
            seam=None if seam is None else seam.nodes,
            slope_by_constant=self._by_constant,
        )
        self._before = (None if self._last is None else self._last.surface), self._before[0]
        self._last = None
        if fit is not None and self._drift is not None:
            self._last = _Last(surface, self._integrator.linear(x, y), noise, fit, systematic)
        return surface

    def _left_open_mm(self, geometry: GeometrySpec | None, read: Reading, island: Mask) -> list[Float]:
        """Errors (rows, cols) of depth, mm, one sigma of each mode that a zero left open."""
        if geometry is None:
            return []
        if self._left_open is None or self._left_open[0] != geometry:
            at = self._rest_point
            self._left_open = geometry, np.nan_to_num(geometry.fields(at[..., 0], at[..., 1]))
        both = np.stack([read.depth, read.slope[..., 0], read.slope[..., 1]])
        return [np.where(island, (mode * both).sum(axis=0), 0.0) for mode in self._left_open[1]]

    def _arrays(self, nodes: Mask, read: ReadNodes, sigma_depth: Float, variance: Float) -> dict[str, Any]:
        """Arrays of a `Surface` on the full grid, NaN off the `nodes`; variance: (rows, cols, 2) of slope."""
        return {
            **surface_arrays(
                PADDING, self._rest_xy, nodes, read.depth, read.slope, sigma_depth, variance, read.point
            ),
            "sigma_x_mm": self._sigma_place[0],
            "sigma_y_mm": self._sigma_place[1],
        }

    def _with_cut_off(
        self, surface: Surface, reading: Reading, q: Float, usable: Mask, variance: Float
    ) -> Surface:
        """The surface with the nodes tied to it over gaps; the same one where there are none."""
        island = self._integrator.island
        others = cut_off_parts(usable, island) if island.any() else []
        read = ReadNodes(reading.depth, reading.slope, reading.point)
        found = bridge(self._rays, q, variance, self._scale, island, others, read) if others else None
        if found is None:
            return surface
        # noise over a gap adds little to that of the nodes before it
        noise = surface.sigma_depth_mm[self._grid.inner] ** 2 - (self._depth_share * reading.depth) ** 2
        largest = np.nanmax(noise) if np.isfinite(noise).any() else np.nan
        sigma_depth = np.hypot(float(np.sqrt(largest)), found.sigma_mm)
        sigma_depth = np.hypot(sigma_depth, self._depth_share * found.read.depth)
        arrays = self._arrays(found.nodes, found.read, sigma_depth, variance)
        cut_off = replace(surface, **arrays, valid=self._grid.padded(found.nodes, False))
        whole = replace(surface, cut_off=cut_off)
        if self._last is not None:
            self._last = replace(self._last, surface=whole)
        return whole
