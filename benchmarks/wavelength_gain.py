"""Whether the peak of a dent comes back whole, whatever its width.

Gaussian dents of sigma 4 to 64 nodes at full size, half a node off the middle: a formula, which no rubber
makes, as the question is what is left of a width, and a load's dent has all widths. "reading": depth read
from the exact warp. "loop": the press stands before the loop starts, noise and clocks as in the packaged rig;
the mean depth over the locked frames. Public tactile SDKs give 0.4 to 0.8 of the peak for narrow dents.

How deep: 0.4 of what would fold (a Gaussian's concave ring has 0.446 of its centre's curvature), slopes up to
20 mrad (total reflection lasts), at most 0.2 mm.

Slopes fix depth up to one multiple of a known field h (`SurfaceReader.scale`). It is taken from the rubber at
rest; where the dent fills the view (it is more than 1e-4 of its peak at the farthest nodes) nothing in view
rests, and that one number is fitted to the true depth at the tenth of the nodes farthest from the peak.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.anchors import View
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import VIEW_MIDDLE_MM, opened, pressed
from zeromethod.arrays import Float
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import Surface, peak
from zeromethod.view.progress import Advance, progress

SIGMAS_NODES = (4, 6, 8, 16, 32, 64)
WITHIN = 0.002
FOLD_SHARE, MOST_SLOPE, MOST_MM = 0.4, 0.02, 0.2
RING_CURVATURE = 0.446
FAR_SHARE = 0.1
FILLS_VIEW = 1e-4
FRAMES_TO_LOCK, FRAMES_READ = 24, 16


@dataclass(frozen=True)
class Gain:
    """Read over true peak of one dent. anchor: "rest", or "fitted" where the dent fills the view."""

    sigma_nodes: int
    sigma_mm: float
    depth_mm: float
    anchor: str
    reading: float
    loop: float
    loop_error: float
    locked_frames: int


class Bench:
    """The rig's optics, nodes and reader, and the middle of its view."""

    def __init__(self, rig: Rig) -> None:
        self.view = View(rig)
        self.grid, self.reader = self.view.grid, self.view.reader
        self.rest = self.view.optics.trace(*self.grid.mesh(), self.view.optics.rest)
        x = self.rest.point[self.grid.shape[0] // 2, :, 0]
        y = self.rest.point[:, self.grid.shape[1] // 2, 1]
        middle = int(np.nanargmin(np.abs(x - VIEW_MIDDLE_MM)))
        self.pitch_mm = float(np.nanmean([np.diff(x)[middle], np.nanmedian(np.diff(y))]))
        self.at_mm = (float(x[middle] + 0.5 * np.diff(x)[middle]), 0.5 * float(np.nanmedian(np.diff(y))))

    def mirror(self, sigma_mm: float) -> Mirror:
        """Gaussian dent as deep as the module says."""
        inside = self.rest.reaches_display
        lever = 2 * np.nanmax(self.rest.path_mm[inside]) / np.nanmin(self.rest.cos_incidence[inside])
        folds_mm = sigma_mm**2 / (RING_CURVATURE * lever)
        depth_mm = min(FOLD_SHARE * folds_mm, MOST_SLOPE * sigma_mm * np.exp(0.5), MOST_MM)
        return Mirror((Dent(Shape.GAUSSIAN, *self.at_mm, float(depth_mm), sigma_mm),))

    def gain(self, surface: Surface, mirror: Mirror) -> tuple[float, str]:
        """(peak read / true peak, where depth was taken from)."""
        dent = mirror.dents[0]
        away = np.hypot(surface.x_mm - dent.x_mm, surface.y_mm - dent.y_mm)
        far = surface.valid & (away >= np.quantile(away[surface.valid], 1 - FAR_SHARE))
        truth = mirror.depth(surface.x_mm[far], surface.y_mm[far])
        if np.max(np.abs(truth)) < FILLS_VIEW * abs(dent.depth_mm):
            return peak(surface).depth_mm / dent.depth_mm, "rest"
        h = np.full(self.grid.shape, np.nan)
        h[self.grid.inner] = self.reader.scale
        multiple = float((h[far] @ (surface.depth_mm[far] - truth)) / (h[far] @ h[far]))
        fitted = replace(surface, depth_mm=surface.depth_mm - multiple * h)
        return peak(fitted).depth_mm / dent.depth_mm, "fitted"


def through_the_loop(bench: Bench, mirror: Mirror, frames: int) -> tuple[list[Surface], int]:
    """Surfaces of the locked frames among the last `frames` read, and how many were locked."""
    dent = mirror.dents[0]
    surfaces = []
    held = [(0.0, dent.depth_mm)]
    at_mm = dent.x_mm, dent.y_mm
    with pressed(bench.view.rig, held, dent.size_mm, at_mm, "gaussian") as rig, opened(rig) as running:
        for step in running.loop.run(frames=FRAMES_TO_LOCK + frames):
            number = step.frame_number or 0
            if number >= FRAMES_TO_LOCK and step.measured is not None and step.state is State.LOCKED:
                surfaces.append(bench.reader.read(step.measured))
    return surfaces, len(surfaces)


def mean_surface(surfaces: list[Surface]) -> Surface:
    """Mean depth and place of surfaces, valid where all are."""

    def mean(name: str) -> Float:
        return np.asarray(np.mean([getattr(surface, name) for surface in surfaces], axis=0))

    return replace(
        surfaces[0],
        depth_mm=mean("depth_mm"),
        x_mm=mean("x_mm"),
        y_mm=mean("y_mm"),
        valid=np.all([surface.valid for surface in surfaces], axis=0),
    )


def gain_at(bench: Bench, sigma_nodes: int, frames: int = FRAMES_READ) -> Gain:
    """Both gains for one width."""
    sigma_mm = sigma_nodes * bench.pitch_mm
    mirror = bench.mirror(sigma_mm)
    reading, anchor = bench.gain(bench.reader.read(bench.view.warp(mirror)), mirror)
    surfaces, locked = through_the_loop(bench, mirror, frames)
    loop = loop_error = float("nan")
    if surfaces:
        loop, anchor = bench.gain(mean_surface(surfaces), mirror)
        each = [bench.gain(surface, mirror)[0] for surface in surfaces]
        loop_error = float(np.std(each) / np.sqrt(len(each)))
    return Gain(sigma_nodes, sigma_mm, mirror.dents[0].depth_mm, anchor, reading, loop, loop_error, locked)


def measure(sigmas: tuple[int, ...], frames: int = FRAMES_READ) -> Report:
    """Gains for these widths, in nodes."""
    bench = Bench(load_rig("simulated"))
    gains = []
    with progress(len(sigmas), "gain") as bar:
        gains = [_stepped(bar, gain_at(bench, sigma, frames)) for sigma in sigmas]
    header = ["sigma, nodes", "sigma, mm", "depth, um", "zero from", "reading", "loop", "+-", "locked frames"]
    rows = [
        [
            str(g.sigma_nodes),
            f"{g.sigma_mm:.3f}",
            f"{1e3 * g.depth_mm:.1f}",
            g.anchor,
            f"{g.reading:.5f}",
            f"{g.loop:.5f}",
            f"{g.loop_error:.5f}",
            str(g.locked_frames),
        ]
        for g in gains
    ]
    figures = []
    for name, values in (("reading alone", [g.reading for g in gains]), ("loop", [g.loop for g in gains])):
        worst = values[int(np.argmax(np.abs(np.nan_to_num(values, nan=np.inf) - 1)))]
        figures.append(
            Figure(
                f"peak read / true, {name}, worst",
                f"{worst:.5f}",
                f"1.000 +- {WITHIN}",
                bool(abs(worst - 1) <= WITHIN),
            )
        )
    return Report(
        "Gain at the peak of Gaussian dents", figures, [header, *rows], {"gains": [asdict(g) for g in gains]}
    )


def _stepped(bar: Advance, gain: Gain) -> Gain:
    bar()
    return gain


@benchmark("wavelength_gain", __doc__)
def command(quick: bool) -> Report:
    return measure((4, 16, 64), 8) if quick else measure(SIGMAS_NODES)


if __name__ == "__main__":
    start(command)
