"""From slopes to depth: this system's integrator and two solvers in closed form.

A Gaussian dent is planted: a formula, of which nothing lies beyond the view, as the peers need it. Every
method gets its exact slopes at the nodes, and then the same with white noise. Cases: nodes on a regular
lattice; the nodes of the packaged rig, which perspective spreads irregularly over the mirror; and those with
a hole and without the corners. The peers integrate derivatives per node; on irregular nodes they are given
slope times the nodes' spacing (second-order differences of the coordinates), and where the mask has no slope,
0, as neither can leave a node out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers import cosine_transform, frankot_chellappa
from zeromethod.arrays import Float, Mask
from zeromethod.optics import Dented, Optics
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import SurfaceReader
from zeromethod.surface.integrate import SlopeIntegrator, largest_island
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

Figures = dict[str, Any]
OnStep = Callable[[str], None]

PEAK_MM, SIGMA_MM = 0.2, 5.0
SLOPE_NOISE_RAD = 5e-5
SYSTEM, READER = "SlopeIntegrator (this system)", "SurfaceReader, warp to depth"
CASES = ("regular", "irregular", "mask")


@dataclass(frozen=True)
class Task:
    """Slopes (rows, cols, 2) of a planted depth at points x, y (mm), to be integrated where `valid`."""

    x_mm: Float
    y_mm: Float
    valid: Mask
    slope: Float
    depth_mm: Float

    def error_percent(self, read_mm: Float) -> float:
        """Rms of read minus planted depth over the mask, best constant removed, in % of the peak."""
        wrong = (read_mm - self.depth_mm)[self.valid]
        return 100 * float(np.std(wrong)) / PEAK_MM


Method = Callable[[Float], Float]
"""Slope (rows, cols, 2) -> depth (rows, cols), made for one set of points and one mask."""


def steps(quick: bool) -> int:
    """How often `measure` reports a step."""
    return 1 + len(CASES) * _rounds(quick) + 1


def _rounds(quick: bool) -> int:
    return 3 if quick else 9


def measure(figures: Figures, on_step: OnStep, quick: bool) -> None:
    """Fill `figures` as they are measured: by method and case times in ms and errors in % of the peak."""
    rng = np.random.default_rng(1)
    rig = binned(load_rig("simulated"), 2 if quick else 1)
    optics = Optics(rig)
    grid = NodeGrid.of_rig(rig)
    reader = SurfaceReader(rig, optics, grid)
    tasks = dict(zip(CASES, _tasks(optics, grid), strict=True))
    figures.update(
        nodes=list(tasks["regular"].valid.shape[::-1]),
        peak_mm=PEAK_MM,
        sigma_mm=SIGMA_MM,
        slope_noise_rad=SLOPE_NOISE_RAD,
        rounds=_rounds(quick),
    )
    methods: dict[str, Figures] = figures.setdefault("methods", {})
    on_step("integration")
    for case, task in tasks.items():
        contenders = {name: make(task) for name, make in INTEGRATORS.items()}
        ms: dict[str, list[float]] = {name: [] for name in contenders}
        noisy: dict[str, list[float]] = {name: [] for name in contenders}
        for _ in range(_rounds(quick)):
            slope = task.slope + SLOPE_NOISE_RAD * rng.standard_normal(task.slope.shape)
            for name, integrate in contenders.items():
                started = time.perf_counter()
                depth = integrate(slope)
                ms[name].append(1e3 * (time.perf_counter() - started))
                noisy[name].append(task.error_percent(depth))
            on_step(f"integration, {case}")
        for name, integrate in contenders.items():
            methods.setdefault(name, {})[case] = {
                "ms": {"median": float(np.median(ms[name])), "p90": float(np.percentile(ms[name], 90))},
                "error_percent": task.error_percent(integrate(task.slope)),
                "noisy_error_percent": float(np.sqrt(np.mean(np.square(noisy[name])))),
            }
    methods[READER] = {"irregular": _reading(reader, optics, grid, _rounds(quick))}
    on_step("")


def _tasks(optics: Optics, grid: NodeGrid) -> tuple[Task, Task, Task]:
    rest = optics.trace(*grid.mesh(), optics.rest)
    inner = grid.inner
    x, y = rest.point[inner][..., 0], rest.point[inner][..., 1]
    press = _press(x, y)
    rows, cols = x.shape
    pitch_x, pitch_y = float(np.ptp(x)) / (cols - 1), float(np.ptp(y)) / (rows - 1)
    u, v = np.meshgrid(np.arange(cols) - (cols - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    everywhere = np.ones((rows, cols), bool)
    regular = _task(press, press.dents[0].x_mm + pitch_x * u, press.dents[0].y_mm + pitch_y * v, everywhere)
    # A contact next to the peak, and a round field of view.
    hole = np.hypot(u - cols / 8, v + rows / 10) < rows / 12
    view = np.hypot(u / cols, v / rows) < 0.55
    return regular, _task(press, x, y, everywhere), _task(press, x, y, largest_island(view & ~hole))


def _press(x: Float, y: Float) -> Mirror:
    return Mirror((Dent(Shape.GAUSSIAN, float(np.mean(x)), float(np.mean(y)), PEAK_MM, SIGMA_MM),))


def _task(press: Mirror, x: Float, y: Float, valid: Mask) -> Task:
    slope = np.stack(press.slope(x, y), axis=-1)
    return Task(x, y, valid, np.where(valid[..., None], slope, 0.0), press.depth(x, y))


def _system(task: Task) -> Method:
    integrator = SlopeIntegrator(task.x_mm, task.y_mm)
    variance = np.ones((*task.valid.shape, 2))

    def integrate(slope: Float) -> Float:
        integrator.prepare(task.valid, variance)
        return integrator.integrate(slope, task.x_mm, task.y_mm)

    return integrate


def _peer(solve: Callable[[Float, Float], Float]) -> Callable[[Task], Method]:
    def make(task: Task) -> Method:
        per_row, per_col = (np.gradient(np.stack([task.x_mm, task.y_mm], axis=-1), axis=k) for k in (0, 1))
        keep = task.valid[..., None]

        def integrate(slope: Float) -> Float:
            known = np.where(keep, slope, 0.0)
            depth: Float = solve((known * per_col).sum(axis=-1), (known * per_row).sum(axis=-1))
            return depth

        return integrate

    return make


INTEGRATORS: dict[str, Callable[[Task], Method]] = {
    SYSTEM: _system,
    "Frankot-Chellappa, mirrored": _peer(frankot_chellappa.integrate),
    "cosine transform": _peer(cosine_transform.integrate),
}
"""Makers by name."""


def _reading(reader: SurfaceReader, optics: Optics, grid: NodeGrid, rounds: int) -> Figures:
    """The whole reading of an exact warp: rays through all layers, slopes, integration, anchor, repeated."""
    u, v = grid.mesh()
    x, y = (optics.trace(u, v, optics.rest).point[grid.inner][..., k] for k in (0, 1))
    press = _press(x, y)
    trace = optics.trace(u, v, Dented(optics.rest, press))
    flags = np.full(grid.shape, Flag.OUTSIDE, np.uint16)
    flags[grid.inner] = 0
    flags[~trace.reaches_display] |= np.uint16(Flag.NO_RAY)
    warp = Warp(trace.q, np.full(trace.q.shape, 0.01), flags, 0)
    ms = []
    for _ in range(rounds):
        started = time.perf_counter()
        surface = reader.read(warp)
        ms.append(1e3 * (time.perf_counter() - started))
    at = surface.valid
    wrong = surface.depth_mm[at] - press.depth(surface.x_mm[at], surface.y_mm[at])
    return {
        "ms": {"median": float(np.median(ms)), "p90": float(np.percentile(ms, 90))},
        "error_percent": 100 * float(np.sqrt(np.mean(wrong**2))) / PEAK_MM,
    }
