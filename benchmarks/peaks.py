"""Whether peaks and their sigma are true: random presses through the whole loop, on known geometry.

Half are loads as curved as Gaussian dents of sigma 1.5 to 15 mm, the others rods, rings, what is rough, two
or three loads, and loads beside one 20 mm outside the view; held, pressed slowly and sliding, anywhere in the
middle of the view, 5 to 40 % as deep as what folds (at most 0.2 mm, slopes up to 20 mrad). What is narrower
than 4 mm is seen by the middle 640 x 512 pixels of the packaged camera, the rest by all of it at half the
resolution of camera and LCD. Of every press one frame counts, the last one in which the loop was locked.

z: error over stated sigma; 1 rms where sigma is true.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import click
import numpy as np

from benchmarks.pads import HOLLOW, STEEPEST, bar, pad
from benchmarks.parts import Parts, part_options
from benchmarks.report import Report, benchmark, figure, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, coarser, opened
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import SIGMAS, estimate, rate, rms
from zeromethod.arrays import Float
from zeromethod.cli.numbers import Whole
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.loads import ring, rough
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface import SurfaceReader, peak
from zeromethod.surface.comparison import true_peak_mm

PRESSES, QUICK = 240, 40
AT_ONCE = 20
"""Presses that follow each other in one run of the loop."""
DWELL_FRAMES, TAIL_S = 18, 0.010
NARROW_MM = 4.0
MOTIONS = ("hold", "hold", "press", "slide")
RING_CURVATURE, LEVER_MM = 0.446, 2 * 24.0 / 0.62
MOST_SLOPE, MOST_MM = 0.02, 0.2
OTHERS = ("rod", "ring", "rough", "several loads", "beside a load out of view")
OUTSIDE_MM, OUTSIDE_SIGMA_MM, OUTSIDE_DEPTH_MM = 38.0, 8.0, 0.15
"""Of the load out of view: from the middle, along x of the middle of the view or along y of all of it."""
ROUGH = 0.6
"""Size of the loads of what is rough, over that of the whole."""
BARS = ((1.5, 3.0, 2e-3), (3.0, 99.0, 1e-3))
"""Loads of sigma from, to, mm: most of the rms error, of depth; the median sigma may be twice that."""
MOST_SIGMA = 0.01
"""Of the others' depth."""


@dataclass(frozen=True)
class Press:
    """One press of the series: dents that come and move together; speeds in mm/s."""

    kind: str
    size_mm: float
    motion: str
    dents: tuple[Dent, ...]
    speed_mm_s: tuple[float, float] = (0.0, 0.0)

    def paths(self, from_s: float, to_s: float) -> Iterator[PressPath]:
        """Those of its dents."""
        times_ns = [round(1e9 * time_s) for time_s in (from_s, from_s, to_s, to_s)]
        begin = 0.5 if self.motion == "press" else 1.0
        dx, dy = (v * (to_s - from_s) for v in self.speed_mm_s)
        for dent in self.dents:
            x, y, deep = dent.x_mm, dent.y_mm, dent.depth_mm
            places = (x, y, 0.0), (x, y, begin * deep), (x + dx, y + dy, deep), (x + dx, y + dy, 0.0)
            points = (PathPoint(time, *place) for time, place in zip(times_ns, places, strict=True))
            yield PressPath(dent, tuple(points))


@dataclass(frozen=True)
class Found:
    """What one press was read as, mm."""

    kind: str
    motion: str
    size_mm: float
    depth_mm: float
    error_mm: float
    sigma_mm: float

    @property
    def z(self) -> float:
        """Error over stated sigma."""
        return self.error_mm / self.sigma_mm


def random_presses(count: int) -> list[Press]:
    """Draw presses, widths evenly in their logarithm."""
    draw = generator(0)
    presses = []
    for number in range(count):
        kind = "load" if number % 2 else OTHERS[number // 2 % len(OTHERS)]
        motion = MOTIONS[number // 10 % len(MOTIONS)]
        size = float(np.exp(draw.uniform(np.log(1.5), np.log(15.0 if kind == "load" else 5.0))))
        # what is rough is made of narrower loads
        narrow = ROUGH * size if kind == "rough" else size
        folds = narrow**2 / (HOLLOW * LEVER_MM)
        depth = float(min(draw.uniform(0.05, 0.4) * folds, MOST_SLOPE * narrow / STEEPEST, MOST_MM))
        at = VIEW_MIDDLE_MM + float(draw.uniform(-3, 3)), float(draw.uniform(-2.5, 2.5))
        angle = draw.uniform(0, 2 * np.pi)
        speed = draw.uniform(2, 10) if motion == "slide" else 0.0
        moving = (float(speed * np.cos(angle)), float(speed * np.sin(angle)))
        presses.append(Press(kind, size, motion, _dents(kind, at, size, depth, draw), moving))
    return presses


def _dents(
    kind: str, at: tuple[float, float], size_mm: float, depth_mm: float, draw: np.random.Generator
) -> tuple[Dent, ...]:
    (x, y), radius_mm, width_mm = at, float(draw.uniform(1.0, 2.0)) * size_mm, size_mm / 2**0.5
    if kind == "rod":
        return (bar(x, y, depth_mm, size_mm, float(draw.uniform(3, 8)), float(draw.uniform(0, 180))),)
    if kind == "ring":
        return (ring(x, y, depth_mm, radius_mm, width_mm),)
    if kind == "rough":
        return (rough(x, y, depth_mm, radius_mm, ROUGH * width_mm, int(draw.integers(1000))),)
    dents = [pad(x, y, depth_mm, size_mm)]
    if kind == "beside a load out of view":
        away = (OUTSIDE_MM, 0.0) if size_mm < NARROW_MM else (0.0, OUTSIDE_MM)
        dents.append(pad(x + away[0], y + away[1], OUTSIDE_DEPTH_MM, OUTSIDE_SIGMA_MM))
    for _ in range(draw.integers(1, 3) if kind == "several loads" else 0):
        angle, away_mm = draw.uniform(0, 2 * np.pi), draw.uniform(2.0, 4.0) * size_mm
        x_mm, y_mm = x + float(away_mm * np.cos(angle)), y + float(away_mm * np.sin(angle))
        dents.append(pad(x_mm, y_mm, float(draw.uniform(0.3, 0.8)) * depth_mm, size_mm))
    return tuple(dents)


def middle_of_the_view(rig: Rig) -> Rig:
    """The rig with the middle 640 x 512 pixels of its camera alone."""
    return changed(rig, camera={"columns": 640, "rows": 512, "centre_px": (319.5, 255.5)})


def through_the_loop(rig: Rig, presses: Sequence[Press]) -> list[Found]:
    """Press one after the other; presses in which the loop never locked are left out."""
    dwell_s = DWELL_FRAMES / rig.camera.rate_hz
    spans = [(k * dwell_s, (k + 1) * dwell_s) for k in range(len(presses))]
    paths = [path for press, span in zip(presses, spans, strict=True) for path in press.paths(*span)]
    last = {}
    with opened(rig, scenario=Scenario("presses", tuple(paths), 1e9)) as bench:
        reader = SurfaceReader(rig, bench.optics, bench.loop.grid)
        for step in bench.loop.run(frames=DWELL_FRAMES * len(presses)):
            if step.measured is None or step.state is not State.LOCKED:
                continue
            time_s = 1e-9 * step.measured.time_ns
            number = int(time_s / dwell_s)
            if number < len(presses) and time_s < spans[number][1] - TAIL_S:
                last[number] = step.measured.copy()
        found = []
        for number, warp in last.items():
            if warp.time_ns < 1e9 * (spans[number][0] + 0.5 * dwell_s):
                continue
            press, surface = presses[number], reader.read(warp)
            read, seen = peak(surface), surface.on_mirror
            true_mm = true_peak_mm(bench.truth(warp.time_ns), surface.x_mm[seen], surface.y_mm[seen])
            error = read.depth_mm - true_mm
            found.append(Found(press.kind, press.motion, press.size_mm, true_mm, error, read.sigma_mm))
    return found


def percents(found: Sequence[Found]) -> tuple[Float, Float]:
    """Errors of depth and their stated sigma, over depth."""
    depth = np.array([f.depth_mm for f in found])
    return np.array([f.error_mm for f in found]) / depth, np.array([f.sigma_mm for f in found]) / depth


def _row(name: str, found: Sequence[Found]) -> list[str]:
    z = np.array([f.z for f in found])
    error, sigma = (100 * one for one in percents(found))
    return [
        name,
        str(len(found)),
        f"{rms(error):.4f}",
        f"{np.median(sigma):.4f}",
        f"{rms(z):.2f}",
        f"{100 * np.mean(np.abs(z) <= 2):.0f} %",
        f"{np.abs(z).max():.1f}",
    ]


def report(count: int, kept: Parts) -> Report:
    """All presses, or those of them that are still missing in `kept`."""
    rig = changed(load_rig("simulated"), simulation={"seed": seed(0)})
    presses = random_presses(count)
    narrow = [p for p in presses if p.size_mm < NARROW_MM]
    wide = [p for p in presses if p.size_mm >= NARROW_MM]
    series = [(middle_of_the_view(rig), narrow), (coarser(rig, 2), wide)]
    parts = [(r, all_of[k : k + AT_ONCE]) for r, all_of in series for k in range(0, len(all_of), AT_ONCE)]
    runs = kept.run(len(parts), "presses", lambda k: [asdict(one) for one in through_the_loop(*parts[k])])
    found = [Found(**one) for run in runs for one in run]
    groups = {"all": found}
    groups |= {motion: [f for f in found if f.motion == motion] for motion in dict.fromkeys(MOTIONS)}
    groups |= {kind: [f for f in found if f.kind == kind] for kind in ("load", *OTHERS)}
    edges = (1.5, 2.1, 3.0, 4.0, 6.0, 15.0)
    for low, high in pairwise(edges):
        groups[f"{low:g} to {high:g} mm"] = [f for f in found if low <= f.size_mm < high]
    header = ["presses", "read", "rms, %", "sigma, %", "z rms", "within 2 sigma", "largest z"]
    rows = [_row(name, group) for name, group in groups.items() if group]
    z = np.array([f.z for f in found])
    beyond = int(np.count_nonzero(np.abs(z) > SIGMAS))
    figures = [
        figure("error of locked peaks over sigma, rms", *estimate(rms, z), least=0.7, most=1.3),
        figure("locked peaks beyond 3 sigma", *rate(beyond, len(z)), unit="%", most=0.01),
        figure(f"of {count} presses: read while locked", len(found), least=0.98, of_other=True),
    ]
    for low, high, most in BARS:
        loads = [f for f in found if f.kind == "load" and low <= f.size_mm < high]
        error, sigma = percents(loads)
        name = f"loads of sigma {low:g} to {high:g} mm"
        figures += [
            figure(f"{name}: error, rms", *estimate(rms, error), unit="%", most=most),
            figure(f"{name}: stated sigma, median", *estimate(np.median, sigma), unit="%", most=2 * most),
        ]
    others = [f for f in found if f.kind != "load"]
    figures += [
        figure("others: error over sigma, rms", *estimate(rms, [f.z for f in others]), least=0.7, most=1.3),
        figure(
            "others: stated sigma, median",
            *estimate(np.median, percents(others)[1]),
            unit="%",
            most=MOST_SIGMA,
        ),
    ]
    return Report("Peaks of random presses", figures, [header, *rows], {"peaks": [asdict(f) for f in found]})


@benchmark(
    "peaks",
    __doc__,
    click.option("--presses", type=Whole(min=1), default=PRESSES, show_default=True, help="How many."),
    part_options,
    salt_option,
)
def command(quick: bool, presses: int, keep: Path | None, most_runs: int | None) -> Report:
    count = QUICK if quick else presses
    return report(count, Parts(keep, most_runs, presses=count))


if __name__ == "__main__":
    start(command)
