"""Whether peaks and their sigma are true: random presses through the whole loop, on known geometry.

Gaussians of sigma 1.5 to 15 mm, straight edges, and dents that fall like 1/r as rubber's do,
1 / sqrt(1 + r^2 / a^2); held, pressed slowly and sliding, anywhere in the middle of the view, 5 to 40 % as
deep as what folds (at most 0.2 mm, slopes up to 20 mrad). Dents below 4 mm are seen by the middle 640 x 512
pixels of the packaged camera, wider ones by all of it at half the resolution of camera and LCD. Of every
press one frame counts, the last one in which the loop was locked.

z: error over stated sigma; 1 rms where sigma is true. "bias": mean error in percent of depth, of held
Gaussians, with its standard error.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Report, benchmark, figure, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, coarser, opened
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import SIGMAS, estimate, rate, rms
from zeromethod.cli.numbers import Whole
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Shape
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
MAP_FILE, MAP_PITCH, MAP_HALF = "far.npy", 0.1, 500
"""Height map of the 1/r dent: pitch over a, samples to either side."""
KINDS = ("gaussian", "edge", "map")
MOST_BIAS = ((1.5, 3.0, 1.5e-3), (3.0, 99.0, 5e-4))
"""Size from, to, mm, and the largest bias there, of depth."""


@dataclass(frozen=True)
class Press:
    """One press of the series; speeds in mm/s."""

    shape: Shape
    size_mm: float
    depth_mm: float
    at_mm: tuple[float, float]
    motion: str
    length_mm: float = 0.0
    angle_deg: float = 0.0
    speed_mm_s: tuple[float, float] = (0.0, 0.0)

    def table(self, from_s: float, to_s: float) -> str:
        """Its table in a press file."""
        x, y = self.at_mm
        begin = 0.5 * self.depth_mm if self.motion == "press" else self.depth_mm
        dx, dy = (v * (to_s - from_s) for v in self.speed_mm_s)
        points = [(from_s, x, y, 0.0), (from_s, x, y, begin), (to_s, x + dx, y + dy, self.depth_mm)]
        points.append((to_s, x + dx, y + dy, 0.0))
        path = ",".join(f"{{time_s={t!r},x_mm={a!r},y_mm={b!r},depth_mm={d!r}}}" for t, a, b, d in points)
        sigma = f"sigma_mm={self.size_mm!r}"
        keys = {
            Shape.GAUSSIAN: sigma,
            Shape.EDGE: f"{sigma}\nlength_mm={self.length_mm!r}\nangle_deg={self.angle_deg!r}",
            Shape.MAP: f'pitch_mm={MAP_PITCH * self.size_mm!r}\nfile="{MAP_FILE}"',
        }
        return f'[[press]]\nshape="{self.shape.value}"\n{keys[self.shape]}\npath=[{path}]\n'


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
        shape = (Shape.GAUSSIAN, Shape.GAUSSIAN, Shape.EDGE, Shape.MAP)[number % 4]
        motion = MOTIONS[number // 4 % 4]
        widest = 15.0 if shape is Shape.GAUSSIAN else 5.0
        width = float(np.exp(draw.uniform(np.log(1.5), np.log(widest))))
        folds = width**2 / (RING_CURVATURE * LEVER_MM)
        depth = float(min(draw.uniform(0.05, 0.4) * folds, MOST_SLOPE * width * np.exp(0.5), MOST_MM))
        at = (VIEW_MIDDLE_MM + draw.uniform(-3, 3), draw.uniform(-2.5, 2.5))
        angle = draw.uniform(0, 2 * np.pi)
        speed = draw.uniform(2, 10) if motion == "slide" else 0.0
        length, turned = draw.uniform(3, 8), draw.uniform(0, 180)
        moving = (float(speed * np.cos(angle)), float(speed * np.sin(angle)))
        place = (float(at[0]), float(at[1]))
        press = Press(shape, width, depth, place, motion, speed_mm_s=moving)
        if shape is Shape.EDGE:
            press = replace(press, length_mm=float(length), angle_deg=float(turned))
        presses.append(press)
    return presses


def middle_of_the_view(rig: Rig) -> Rig:
    """The rig with the middle 640 x 512 pixels of its camera alone."""
    return changed(rig, camera={"columns": 640, "rows": 512, "centre_px": (319.5, 255.5)})


def through_the_loop(rig: Rig, presses: Sequence[Press]) -> list[Found]:
    """Press one after the other; presses in which the loop never locked are left out."""
    dwell_s = DWELL_FRAMES / rig.camera.rate_hz
    spans = [(k * dwell_s, (k + 1) * dwell_s) for k in range(len(presses))]
    text = "".join(press.table(*span) for press, span in zip(presses, spans, strict=True))
    last = {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "presses.toml"
        file.write_text(text)
        away = MAP_PITCH * np.arange(-MAP_HALF, MAP_HALF + 1)
        np.save(Path(folder) / MAP_FILE, 1 / np.sqrt(1 + away**2 + away[:, None] ** 2))
        with opened(rig.model_copy(update={"scenario": str(file)})) as bench:
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
                kind = press.shape.value
                found.append(Found(kind, press.motion, press.size_mm, true_mm, error, read.sigma_mm))
    return found


def bias_percent(found: Sequence[Found]) -> tuple[float, float]:
    """Mean error of depth, percent, and its standard error; weights by the stated sigma."""
    share = np.array([f.error_mm / f.depth_mm for f in found])
    weight = np.array([(f.depth_mm / f.sigma_mm) ** 2 for f in found])
    mean = float((weight * share).sum() / weight.sum())
    scatter = np.array([f.z for f in found]).std()
    return 100 * mean, 100 * float(scatter / np.sqrt(weight.sum()))


def _row(name: str, found: Sequence[Found]) -> list[str]:
    z = np.array([f.z for f in found])
    error = 1e6 * np.array([f.error_mm for f in found])
    sigma = 1e6 * float(np.median([f.sigma_mm for f in found]))
    bias, spread = bias_percent(found)
    return [
        name,
        str(len(found)),
        f"{bias:+.4f} +- {spread:.4f}",
        f"{np.sqrt(np.mean(error**2)):.1f}",
        f"{sigma:.1f}",
        f"{np.sqrt(np.mean(z**2)):.2f}",
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
    groups |= {kind: [f for f in found if f.kind == kind] for kind in KINDS}
    edges = (1.5, 2.1, 3.0, 4.0, 6.0, 15.0)
    for low, high in pairwise(edges):
        groups[f"{low:g} to {high:g} mm"] = [f for f in found if low <= f.size_mm < high]
    header = ["presses", "read", "bias, %", "rms, nm", "sigma, nm", "z rms", "within 2 sigma", "largest z"]
    rows = [_row(name, group) for name, group in groups.items() if group]
    z = np.array([f.z for f in found])
    beyond = int(np.count_nonzero(np.abs(z) > SIGMAS))
    figures = [
        figure("error of locked peaks over sigma, rms", *estimate(rms, z), least=0.7, most=1.3),
        figure("locked peaks beyond 3 sigma", *rate(beyond, len(z)), unit="%", most=0.01),
        figure(f"of {count} presses: read while locked", len(found), least=0.98, of_other=True),
    ]
    for low, high, most in MOST_BIAS:
        held = [f for f in found if f.kind == "gaussian" and f.motion == "hold" and low <= f.size_mm < high]
        if held:
            bias = (0.01 * value for value in bias_percent(held))
            name = f"bias of held Gaussians, sigma from {low:g} mm"
            figures.append(figure(name, *bias, unit="%", least=-most, most=most))
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
