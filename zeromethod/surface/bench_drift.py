"""What the bench's own motion does to a reading: drift that sigma must include, and motion under a press."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.bench_motion.watch import BenchWatch
from zeromethod.optics import Optics
from zeromethod.surface.anchor import RestFit
from zeromethod.surface.curl import Curl, CurlTest
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.noise import SlopeNoise
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp


class BenchDrift:
    """Drift as seen last while nothing pressed, and the curl test; of one reader."""

    def __init__(
        self,
        optics: Optics,
        grid: NodeGrid,
        rest_q: Float,
        usable: Mask,
        sensitivity: Float,
        integrator: SlopeIntegrator,
        scale: Float,
        scale_gradient: Float,
    ) -> None:
        """Of the measurable nodes, (rows, cols, ...) each: the warp at rest, those to look at, LCD px per rad,
        the integrator's h, and h d(slope)/d(depth)."""
        modes = BenchModes.of(optics, grid)
        self._grid, self._rest = grid, rest_q
        self._rest_q = grid.padded(rest_q, np.nan)
        none = np.zeros(grid.shape, bool)
        self.watch = BenchWatch(modes, grid, grid.padded(usable, False), none, 0)
        u, v = (one[grid.inner] for one in grid.mesh())
        slopes = np.moveaxis(np.linalg.solve(sensitivity, modes.at(u, v)), -1, 0)
        self._integrator, self._scale = integrator, scale
        self._curl = CurlTest(integrator, slopes, scale_gradient)

    def look(self, warp: Warp) -> None:
        """Follow the drift."""
        self.watch.look(warp, self._rest_q)

    def test(self, warp: Warp, slope: Float, point: Float, depth_mm: Float, noise: SlopeNoise) -> Curl:
        """Curl of one converged reading."""
        island = self._integrator.island
        away = warp.q[self._grid.inner][island] - self._rest[island]
        shift_px = float(np.sqrt(np.mean(np.sum(away**2, axis=-1))))
        return self._curl.test(slope, point, depth_mm, noise, shift_px)

    def false_depth(self, fit: RestFit, noise: SlopeNoise, x_mm: Float, y_mm: Float) -> Float:
        """Errors (2, rows, cols) of depth by the drift, mm: under the anchor, and by way of its far field.

        The slope that drift makes at the border passes for a far field that comes from across the view.
        """
        drift, slope = self._curl.false_depth(self.watch.drift, noise, x_mm, y_mm)
        drift = drift - float((fit.weights * drift).sum())
        tail_mm = 0.0
        if fit.mode == "quiet":
            island = self._integrator.island
            reach_mm = 0.5 * float(np.hypot(np.ptp(x_mm[island]), np.ptp(y_mm[island])))
            tail_mm = reach_mm * float((fit.weights * np.where(island, slope, 0.0)).sum())
        result: Float = self._scale * np.stack([drift, np.full_like(drift, tail_mm)])
        return result
