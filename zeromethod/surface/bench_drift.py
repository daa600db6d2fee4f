"""What the bench's own motion does to a reading: drift that sigma must include, and motion under a press."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.bench_motion.watch import BenchWatch
from zeromethod.optics import Optics
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.surface.anchor import NodeReadings, RestFit, known_misfit
from zeromethod.surface.curl import Curl, CurlTest
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.node_passes import mean_square, squares_apart
from zeromethod.surface.noise import SlopeNoise
from zeromethod.surface.seam_steps import SeamSteps
from zeromethod.surface.settling import Reading
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.overlap import overlap_correlation, shared_nodes
from zeromethod.warp.warp import Warp

_NULLED_PX = 0.05
"""Residual rms, camera px, below which a frame is nulled and shows where the bench is; as in the loop."""


class BenchDrift:
    """Drift as seen last while nothing pressed, and the curl test; of one reader."""

    def __init__(
        self,
        rig: Rig,
        optics: Optics,
        grid: NodeGrid,
        rest_q: Float,
        usable: Mask,
        sensitivity: Float,
        integrator: SlopeIntegrator,
        scale_gradient: Float,
        seam: Mask | None,
    ) -> None:
        """sensitivity: LCD px per rad. scale_gradient: h d(slope)/d(depth). All of the measurable nodes.

        seam: those at a saw's seams at rest.
        """
        self._known_rest, self._passive = rig.surface.known_rest, rig.control.passive
        modes = BenchModes.of(optics, grid)
        self._grid, self._rest = grid, rest_q
        self._rest_q = grid.padded(rest_q, np.nan)
        self._shared = shared_nodes(overlap_correlation(grid.period_px, grid.spacing_px))
        none = np.zeros(grid.shape, bool)
        self.watch = BenchWatch(modes, grid, grid.padded(usable, False), none, 0)
        u, v = (one[grid.inner] for one in grid.mesh())
        slopes = np.asarray(np.linalg.solve(sensitivity, modes.at(u, v)), np.float64)
        self._integrator = integrator
        self._curl = CurlTest(integrator, np.moveaxis(slopes, -1, 0), scale_gradient)
        self._steps = None if seam is None else SeamSteps(optics, u, v, seam, sensitivity, self._shared)
        self._nulled = False
        self._left_open: GeometrySpec | None = None

    def look(self, warp: Warp) -> None:
        """Follow the drift, in frames that are nulled, or of a pattern that never is."""
        self._nulled = True
        if warp.left is not None and not self._passive:
            left_px = self.watch.modes.camera_px * np.sqrt(mean_square(warp.left, warp.flags))
            self._nulled = bool(left_px <= _NULLED_PX)
        if self._steps is not None and warp.left_open != self._left_open:
            self._steps.forget()
        self._left_open = warp.left_open
        if self._nulled:
            self.watch.look(warp, self._rest_q)

    def test(self, warp: Warp, read: Reading, noise: SlopeNoise) -> Curl:
        """Curl of one converged reading."""
        island = self._integrator.island
        shift2 = squares_apart(warp.q[self._grid.inner], self._rest, island)
        shift_px = float(np.sqrt(shift2 / np.count_nonzero(island)))
        curl = self._curl.test(read, noise, shift_px)
        return curl if self._steps is None else replace(curl, teeth=self._steps.words)

    def systematic(
        self, fit: RestFit, read: NodeReadings, noise: SlopeNoise, seam: Mask | None
    ) -> tuple[RestFit, list[Float]]:
        """The fit with its sigma, and independent errors (rows, cols) of depth, mm, of one sigma each.

        They are the same in every frame: the anchor's own; that of known nodes which are not at rest; drift
        of the bench; and steps at a saw's seams, whose nodes, (rows, cols), are `seam`. Drift and steps are
        wrong slopes, which make a wrong constant as well.
        """
        x, y, island = read.x_mm, read.y_mm, self._integrator.island
        errors, wrong = [], []
        if fit.mode == "known":
            fit, off_rest = known_misfit(fit, read, self._known_rest, self._shared)
            errors.append(off_rest)
        if self.watch.drift.any():
            wrong.append(self._curl.false_depth(self.watch.drift, noise, x, y))
        if self._steps is not None and seam is not None:
            if self._nulled:
                self._steps.look(read.slope, x, island & ~seam, read.variance)
            if (steps := self._steps.error()) is not None:
                wrong.append((self._integrator.linear(x, y).depth(steps), steps))
        for depth, slope in wrong:
            off = depth - float((fit.weights * depth).sum())
            errors.append(off - fit.false_constant(slope, off))
        scale = read.scale * island
        return fit, [fit.sigma_mm * scale, *(one * scale for one in errors)]
