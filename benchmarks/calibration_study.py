"""What a calibration makes of ten unknown benches: depth of other presses, and whether its sigma is true.

Ten benches drawn at random around the packaged one (binned by 2): LCD shifted by up to 2 mm and turned by up
to 1 degree, camera off by 5 mm and 1 degree, focal length by 2 %, distortion k1 by 0.5, index by 0.01, prism
angle by 0.5 degrees, camera face 0.3 degrees off the pattern face's, LCD wedge up to 0.3 degrees, gap by
0.3 mm, leg by 0.05 mm. Warps are exact ray traces of the drawn bench with 0.02 LCD px of noise at every node;
the calibration starts from the packaged rig with caliper-grade priors and sees nothing else of the truth.

The mirror's edges P0 and R0 are given to 2 camera px of the full-size image where they are in view; the
packaged bench sees neither, so that the LCD's distance to P0 by ruler (0.25 mm) stands in for P0. --wide
shortens the lens to 5600 px, so that both edges are in view. Presses of known depth: 0.2 mm, the height gauge
off by up to 1 um. Other presses: 0.05 to 0.3 mm, elsewhere, loads of other widths, rods, twin loads,
and dry balls, whose depth falls off like 1 / r past the border of the view.

"normalised": error over the sigma stated for it, geometry and reading together. "covered": presses within
twice that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.pads import STEEPEST, bar, pad
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import changed
from benchmarks.salt import generator, salt_option
from benchmarks.totals import estimate, rms
from zeromethod.arrays import Float
from zeromethod.calibration import (
    Direct,
    KnownPress,
    Measurement,
    MirrorEdge,
    Presses,
    Priors,
    RestPositions,
    RestReading,
    build,
    depth_error,
    describe,
    fit,
)
from zeromethod.calibration.rays import UnboundedOptics, mirror_point
from zeromethod.cli.numbers import Whole
from zeromethod.errors import InputError
from zeromethod.optics import Dented, Optics, check_geometry
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface.comparison import true_peak_mm, usable_nodes
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

NOISE_PX, EDGE_PX, RULER_MM = 0.02, 2.0, 0.25
KNOWN_MM, GAUGE_MM = 0.2, 1e-3
KNOWN_SIGMA_MM = 5.0
BINNING, WIDE_FOCAL_PX = 2, 5600.0
TESTS = 10
MOST_SLOPE = 0.025
SPREAD = {
    "display.along_mm": 2.0,
    "display.across_mm": 2.0,
    "display.turn_deg": 1.0,
    "gap_mm": 0.3,
    "camera.x_mm": 5.0,
    "camera.y_mm": 5.0,
    "camera.z_mm": 5.0,
    "camera.heading_deg": 1.0,
    "camera.elevation_deg": 1.0,
    "camera.roll_deg": 1.0,
    "camera.scale": 0.02,
    "camera.k1": 0.5,
    "prism.index": 0.01,
    "prism.pattern_angle_deg": 0.5,
    "prism.captured_less_pattern_deg": 0.3,
    "prism.length_mm": 0.05,
    "rest.scale": 0.02,
    "rest.x_mm": 0.5,
    "rest.y_mm": 0.5,
    "rest.axis_deg": 0.5,
}
"""Half width of the uniform draw of each parameter that the rig has; the wedge is drawn apart, up to 0.3
degrees any way."""
WEDGE_DEG = 0.3
CASES = ("edges and three presses", "one press", "rest map alone")


def draw(nominal: Rig, rng: np.random.Generator) -> Rig:
    """Draw a bench; those whose panel would cut into the prism are drawn again."""
    middle = describe(nominal)
    while True:
        drawn = {name: half for name, half in SPREAD.items() if name in middle}
        values = {name: middle[name] + rng.uniform(-half, half) for name, half in drawn.items()}
        size, way = rng.uniform(0.0, WEDGE_DEG), rng.uniform(0.0, 2 * np.pi)
        values["display.tilt_along_deg"] = size * np.cos(way)
        values["display.tilt_y_deg"] = size * np.sin(way)
        bench = build(nominal, values)
        try:
            check_geometry(bench)
        except InputError:
            continue
        return bench


class Truth:
    """A drawn bench and what is measured on it."""

    def __init__(self, rig: Rig, rng: np.random.Generator) -> None:
        self.rig, self._rng = rig, rng
        self.optics = Optics(rig)
        self.grid = NodeGrid.of_rig(rig)
        self._rest_q = self.optics.rest_map(*self.grid.mesh())
        point = self.optics.trace(*self.grid.mesh(), self.optics.rest).point[self.grid.inner]
        self._low = np.nanmin(point[..., :2], axis=(0, 1))
        self._high = np.nanmax(point[..., :2], axis=(0, 1))

    def warp(self, mirror: Mirror) -> Warp:
        """Measured warp: exact rays with noise, flagged as in a run."""
        q = self.optics.trace(*self.grid.mesh(), Dented(self.optics.rest, mirror)).q
        flags = np.full(self.grid.shape, Flag.OUTSIDE, np.uint16)
        flags[self.grid.inner] = 0
        size = (self.rig.display.columns, self.rig.display.rows)
        flags |= warp_flags(q, self._rest_q, self.grid.period_px, size)
        flags[~usable_nodes(self.optics, self.grid, mirror)] |= np.uint16(Flag.LIGHT_LOST)
        noise = NOISE_PX * self._rng.standard_normal(q.shape)
        return Warp(q + noise, np.full(q.shape, NOISE_PX), flags, 0)

    def place(self, share_x: float, share_y: float) -> tuple[float, float]:
        """Return the mirror point (x, y) in mm at these shares of the view."""
        x, y = self._low + (self._high - self._low) * np.array([share_x, share_y])
        return float(x), float(y)

    def known_press(self, share_x: float) -> KnownPress:
        """Measure a press whose depth the height gauge gives."""
        x, y = self.place(share_x, self._rng.uniform(0.4, 0.6))
        warp = self.warp(Mirror((pad(x, y, KNOWN_MM, KNOWN_SIGMA_MM),)))
        stated = KNOWN_MM + self._rng.uniform(-GAUGE_MM, GAUGE_MM)
        return KnownPress(f"x = {x:.0f} mm", warp, stated, GAUGE_MM / np.sqrt(3))

    def edges(self) -> list[Measurement]:
        """Edges that are in view, to 2 px; P0 by ruler where it is not."""
        camera, found = self.rig.camera, list[Measurement]()
        optics = UnboundedOptics(self.rig)
        u = np.arange(-0.5, camera.columns, 0.125)
        v = np.full_like(u, (camera.rows - 1) / 2)
        x = mirror_point(optics, u, v)[:, 0]
        sigma_px = EDGE_PX / BINNING
        for edge, at_mm in (("P0", 0.0), ("R0", optics.length_mm)):
            place = int(np.argmin(np.abs(x - at_mm)))
            if abs(x[place] - at_mm) < 0.05:
                pixel = np.array([[u[place] + sigma_px * self._rng.standard_normal(), v[place]]])
                found.append(MirrorEdge("P0" if edge == "P0" else "R0", pixel, sigma_px))
            elif edge == "P0":
                name = "display.along_mm"
                value = describe(self.rig)[name] + RULER_MM * self._rng.standard_normal()
                found.append(Direct(name, value, RULER_MM))
        return found


def other_press(
    kind: int, place: Callable[[float, float], tuple[float, float]], rng: np.random.Generator
) -> tuple[Dent, ...]:
    """Draw a press that no calibration sees: load, rod, twin loads, dry ball (its rim may fold).

    place: mirror point, mm, at shares of the view.
    """
    x, y = place(rng.uniform(0.2, 0.8), rng.uniform(0.3, 0.7))
    depth = rng.uniform(0.05, 0.3)
    sigma = max(rng.uniform(3.5, 5.5), STEEPEST * depth / MOST_SLOPE)
    if kind == 1:
        length, angle = rng.uniform(6.0, 10.0), rng.uniform(0.0, 180.0)
        return (bar(x, y, depth, sigma, length, angle),)
    if kind == 2:
        second = pad(x + rng.uniform(1.5, 2.0) * sigma, y, depth / 2, sigma)
        return pad(x, y, depth, sigma), second
    if kind == 3:
        depth, contact = rng.uniform(0.05, 0.12), rng.uniform(5.0, 8.0)
        return (Dent(Shape.BALL, x, y, depth, contact**2 / depth),)
    return (pad(x, y, depth, sigma),)


@dataclass(frozen=True)
class Outcome:
    """Errors and stated sigmas of a bench's other presses, percent, and of its calibration.

    kinds: of the presses. chi2: per degree of freedom. geometry_sigma: stated for the geometry alone.
    """

    bench: int
    case: str
    kinds: tuple[int, ...]
    errors: tuple[float, ...]
    sigmas: tuple[float, ...]
    geometry_sigmas: tuple[float, ...]
    chi2: float
    settled: bool

    @property
    def rms(self) -> float:
        """Rms error, percent."""
        return float(np.sqrt(np.mean(np.square(self.errors))))

    @property
    def covered(self) -> float:
        """Share of presses within twice the stated sigma."""
        return float(np.mean(np.abs(self.errors) <= 2.0 * np.array(self.sigmas)))

    @property
    def normalised(self) -> Float:
        """Errors over stated sigmas."""
        return np.asarray(np.array(self.errors) / np.array(self.sigmas))


def study_bench(number: int, nominal: Rig, tests: int = TESTS, cases: Sequence[str] = CASES) -> list[Outcome]:
    """Calibrate one drawn bench from each set of data, and read other presses through each."""
    rng = generator(5, number)
    truth = Truth(draw(nominal, rng), rng)
    grid, rest = truth.grid, truth.warp(Mirror())
    reading, priors, positions = RestReading.of(grid, rest), Priors.of(nominal), RestPositions.of(grid, rest)
    known = [truth.known_press(share) for share in (0.25, 0.5, 0.75)]
    edges = truth.edges()
    kinds = tuple(k % 4 for k in range(tests))
    mirrors = [Mirror(other_press(kind, truth.place, rng)) for kind in kinds]
    warps = [truth.warp(mirror) for mirror in mirrors]
    middle = np.array([truth.place(a, b) for a in np.linspace(0, 1, 60) for b in np.linspace(0, 1, 40)])
    depths = np.array([true_peak_mm(mirror, middle[:, 0], middle[:, 1]) for mirror in mirrors])
    others = Presses.of(reading, [KnownPress("other", w, d, d) for w, d in zip(warps, depths, strict=True)])
    data: dict[str, list[Measurement]] = {
        CASES[0]: [positions, *edges, Presses.of(reading, known)],
        CASES[1]: [positions, Presses.of(reading, known[1:2])],
        CASES[2]: [positions],
    }
    outcomes, error = [], None
    for case in cases:
        fitted = fit(priors, data[case])
        derivatives = depth_error(fitted, grid, reading) if error is None else error
        error = replace(derivatives, covariance=fitted.covariance)
        calibrated = fitted.rig.replace({"geometry": {"known": "calibrated", **error.modes}})
        outcomes.append(_read(number, case, kinds, others, depths, calibrated))
        outcomes[-1] = Outcome(
            **{**asdict(outcomes[-1]), "chi2": fitted.chi2_per_freedom, "settled": fitted.settled}
        )
    if tuple(cases) == CASES:
        outcomes.append(_read(number, "(the true rig)", kinds, others, depths, truth.rig))
    return outcomes


def _read(
    number: int,
    case: str,
    kinds: tuple[int, ...],
    others: Presses,
    depths: Float,
    rig: Rig,
) -> Outcome:
    peaks = Presses.of(others.reading.prepared(rig), others.presses).peaks(rig)
    found = np.array([peak.depth_mm for peak in peaks])
    x, y = np.array([peak.x_mm for peak in peaks]), np.array([peak.y_mm for peak in peaks])
    geometry = 100.0 * rig.geometry.sigmas(x, y)[0]
    errors = 100.0 * (found / depths - 1.0)
    sigmas = np.hypot(100.0 * np.array([peak.sigma_mm for peak in peaks]) / found, 0.05)
    return Outcome(number, case, kinds, tuple(errors), tuple(sigmas), tuple(geometry), 1.0, True)


def summarise(outcomes: Sequence[Outcome], case: str) -> dict[str, float]:
    """Figures of one case over all benches."""
    mine = [o for o in outcomes if o.case == case]
    rms = np.array([o.rms for o in mine])
    normalised = np.concatenate([o.normalised for o in mine])
    stated = np.concatenate([2.0 * np.array(o.sigmas) for o in mine])
    return {
        "benches": len(mine),
        "rms": float(np.sqrt(np.mean(rms**2))),
        "median": float(np.median(rms)),
        "worst": float(rms.max()),
        "worst_press": float(max(np.abs(o.errors).max() for o in mine)),
        "over_2": float((rms > 2.0).sum()),
        "covered": float(np.mean(np.abs(normalised) <= 2.0)),
        "covered_benches": float(sum(o.covered >= 0.8 for o in mine)),
        "normalised": float(np.sqrt(np.mean(normalised**2))),
        "stated_2_sigma": float(np.median(stated)),
    }


def figures_of(outcomes: Sequence[Outcome], benches: int) -> list[Figure]:
    """Figures with their bars, of errors of other presses."""
    figures, needed = list[Figure](), benches - benches // 10
    for case in CASES:
        s, mine = summarise(outcomes, case), [one for one in outcomes if one.case == case]
        off = 0.01 * np.array([one.rms for one in mine])
        if case == CASES[0]:
            stated = s["stated_2_sigma"]
            figures += [
                figure(f"{case}: error, rms, worst bench", off.max(), unit="%", most=0.02),
                figure(f"{case}: error, rms, median bench", *estimate(np.median, off), unit="%", most=0.006),
                Figure(f"{case}: stated 2 sigma, median", f"{stated:.2f} %", "<= 1 %", stated <= 1.0),
            ]
        if case == CASES[1]:
            within = benches - int(s["over_2"])
            words = f"{within} of {benches}"
            figures.append(Figure(f"{case}: benches within 2 %", words, f">= {needed}", within >= needed))
        covered = int(s["covered_benches"])
        name = f"{case}: benches with 4 of 5 presses within 2 sigma"
        over = estimate(rms, [rms(one.normalised) for one in mine])
        figures += [
            Figure(name, f"{covered} of {benches}", f">= {needed}", covered >= needed),
            figure(f"{case}: error over sigma, rms", *over, least=0.5, most=1.5),
        ]
    return figures


def details_of(cases: Mapping[str, dict[str, float]]) -> list[list[str]]:
    """Table of `summarise` over cases, header first."""
    header = ["data", "rms %", "median %", "worst %", "worst press %", "covered %", "normalised", "2 sigma %"]
    rows = [
        [
            case,
            f"{s['rms']:.2f}",
            f"{s['median']:.2f}",
            f"{s['worst']:.2f}",
            f"{s['worst_press']:.2f}",
            f"{100 * s['covered']:.0f}",
            f"{s['normalised']:.2f}",
            f"{s['stated_2_sigma']:.2f}",
        ]
        for case, s in cases.items()
    ]
    return [header, *rows]


def report(benches: int, *, wide: bool, parts: Parts) -> Report:
    """Study `benches` benches, or those of them that are still missing in `parts`."""
    nominal = load_rig("simulated")
    if wide:
        nominal = changed(nominal, camera={"focal_px": (WIDE_FOCAL_PX, WIDE_FOCAL_PX)})
    nominal = binned(nominal, BINNING)
    runs = parts.run(benches, "benches", lambda number: [_kept(one) for one in study_bench(number, nominal)])
    outcomes = [Outcome(**one) for run in runs for one in run]
    cases = {case: summarise(outcomes, case) for case in (*CASES, "(the true rig)")}
    return Report(
        "Depth of other presses on unknown benches",
        figures_of(outcomes, len(runs)),
        details_of(cases),
        {"outcomes": [asdict(o) for o in outcomes], "cases": cases},
    )


def _kept(one: Outcome) -> dict[str, Any]:
    """As JSON can hold it."""
    return {name: list(map(float, v)) if isinstance(v, tuple) else v for name, v in asdict(one).items()}


@benchmark(
    "calibration_study",
    __doc__,
    click.option("--wide", is_flag=True, help="A shorter lens that sees both edges of the mirror."),
    click.option("--benches", type=Whole(min=1), help="How many.  [default: 10, --quick: 3]"),
    part_options,
    salt_option,
)
def command(quick: bool, wide: bool, benches: int | None, keep: Path | None, most_runs: int | None) -> Report:
    count = benches or (3 if quick else 10)
    return report(count, wide=wide, parts=Parts(keep, most_runs, wide=wide))


if __name__ == "__main__":
    start(command)
