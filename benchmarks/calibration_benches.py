"""Ten unknown benches calibrated by their own pictures, and what their loops then read: no exact warps.

Benches are drawn as in calibration_study.py, with a panel gamma of 1.8 to 2.4, refreshes of 59.8 to 60.2 Hz
with a camera of 60.0 Hz, a panel latency that makes 1 to 3 frames of delay, and two grey levels of noise in
8 bits. The lens is shortened to 5600 px, so that both edges of the mirror are in view. To be quick, camera
pixels are binned by 4, carriers are 8 of them long (nodes lie 1.2 mm apart on the mirror), and the LCD has
half its columns and rows.

The whole calibration (light, rest map, delay, presses) runs on the simulated devices in simulated time, from
the packaged rig file and caliper-grade priors, and finds the mirror's edges in its own pictures. Presses of
known depth: three along x, 0.2 mm, the height gauge off by up to 1 um. Then the loop runs on the calibrated
rig and its measured rest, and is pressed elsewhere: loads of other widths, rods, twin loads, dry
balls, 0.05 to 0.3 mm. Each is read in the last frames while it is held. For the other sets of data the same
frames are read through the rig that those give.

The simulated camera's pictures are ray traced by the simulation's shader or its numpy twin, never by the
reader. "normalised": error over the sigma stated for it, geometry and reading together. "covered": presses
within twice that.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.calibration_study import (
    CASES,
    GAUGE_MM,
    KNOWN_MM,
    WIDE_FOCAL_PX,
    Outcome,
    details_of,
    draw,
    figures_of,
    other_press,
    summarise,
)
from benchmarks.pads import pad
from benchmarks.report import Report, benchmark, figure, start
from benchmarks.rigs import changed
from benchmarks.salt import generator, salt_option, seed
from zeromethod.arrays import Float
from zeromethod.calibration.rays import UnboundedOptics, mirror_point
from zeromethod.cli.numbers import Whole
from zeromethod.commissioning.calibration import Calibration, Plan, Recorded, evaluate, record
from zeromethod.commissioning.calibration.presses import PressWarps
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.loop.state import READ
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Mirror
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface import Peak, SurfaceReader, peak
from zeromethod.surface.comparison import true_peak_mm
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

BINNING, PERIOD_PX = 4, 8
TESTS = 8
KNOWN_SHARES = (0.25, 0.5, 0.75)
KNOWN_SIGMA_MM = 5.0
FRAMES = 12
LEAD_S, MOVE_S, HOLD_S, PAUSE_S = 0.1, 0.15, 0.6, 0.2
LOCK_S = 1.0


def nominal(name: str = "simulated") -> Rig:
    """What every bench's rig file says, of a packaged rig with a flat or curved mirror."""
    rig = load_rig(name)
    coarser = {"columns": rig.display.columns // 2, "rows": rig.display.rows // 2}
    rig = changed(
        rig,
        camera={"focal_px": (WIDE_FOCAL_PX, WIDE_FOCAL_PX)},
        display={**coarser, "pitch_mm": 2 * rig.display.pitch_mm},
        target={"period_px": PERIOD_PX},
    )
    return binned(rig, BINNING).model_copy(update={"scenario": "none"})


def drawn(given: Rig, rng: np.random.Generator, seed: int) -> Rig:
    """Draw a bench with its response, its clocks and its delay."""
    rig = draw(given, rng)
    frame_s = 1.0 / rig.camera.rate_hz
    display = {"gamma": rng.uniform(1.8, 2.4), "latency_s": rng.uniform(0.0, 2.0) * frame_s}
    clocks = {
        "display_refresh_hz": rng.uniform(59.8, 60.2),
        "camera_phase": rng.uniform(0.0, 1.0),
        "seed": seed,
    }
    return changed(rig, display=display, simulation=clocks)


class View:
    """Where the drawn bench looks."""

    def __init__(self, rig: Rig) -> None:
        optics = UnboundedOptics(rig)
        camera = rig.camera
        self.rubber = rig.rubber
        u, v = np.meshgrid(np.linspace(16, camera.columns - 17, 120), np.linspace(16, camera.rows - 17, 90))
        point = mirror_point(optics, u.ravel(), v.ravel())
        inside = (point[:, 0] > 3.0) & (point[:, 0] < optics.length_mm - 3.0)
        inside &= np.isfinite(Optics(rig).rest_map(u.ravel(), v.ravel())).all(axis=-1)
        self.points = point[inside, :2]
        self._low, self._high = self.points.min(axis=0), self.points.max(axis=0)

    def place(self, share_x: float, share_y: float) -> tuple[float, float]:
        """Mirror point (x, y) in mm at these shares of the view."""
        x, y = self._low + (self._high - self._low) * np.array([share_x, share_y])
        return float(x), float(y)


def held(dent: Dent, down_ns: int) -> PressPath:
    """A press that goes down from `down_ns` on, is held, and lifted."""
    times_s = (0.0, MOVE_S, MOVE_S + HOLD_S, 2 * MOVE_S + HOLD_S)
    depths = (0.0, dent.depth_mm, dent.depth_mm, 0.0)
    points = (
        PathPoint(down_ns + round(1e9 * t), dent.x_mm, dent.y_mm, d)
        for t, d in zip(times_s, depths, strict=True)
    )
    return PressPath(dent, tuple(points))


@dataclass
class Hand:
    """Presses when it is asked to, on the simulated mirror."""

    devices: Devices
    presses: Sequence[Dent]
    lines: list[str] = field(default_factory=list)

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:
        """Nothing is shown."""
        del words, total
        return nullcontext(lambda: None)

    def say(self, words: str) -> None:
        """Listen."""
        self.lines.append(words)
        if words.startswith("press") and "now" in words:
            camera = self.devices.camera
            assert isinstance(camera, SimulatedCamera)
            dent = self.presses[int(words.split()[1]) - 1]
            path = held(dent, self.devices.clock.now_ns() + round(1e9 * LEAD_S))
            camera.scenario = Scenario("asked for", (path,), 1e9)


@dataclass
class Followed:
    """What a run publishes: measured warps of nulled steps, and their peaks."""

    warps: list[Warp] = field(default_factory=list)
    peaks: list[Peak] = field(default_factory=list)

    def publish(self, step: Step) -> None:
        """Take one step."""
        if step.peak is not None and step.measured is not None and step.state in READ:
            self.warps.append(step.measured)
            self.peaks.append(step.peak)

    def between(self, from_ns: int, to_ns: int) -> tuple[list[Warp], list[Peak]]:
        """Last frames of an interval."""
        rows = [k for k, warp in enumerate(self.warps) if from_ns <= warp.time_ns <= to_ns][-FRAMES:]
        return [self.warps[k] for k in rows], [self.peaks[k] for k in rows]


def followed(rig: Rig, bench: Rig, presses: Sequence[tuple[Dent, ...]]) -> tuple[Followed, list[int]]:
    """Close the loop on a bench by a calibrated rig, pressed one after the other, each held from `times`."""
    starts = [LOCK_S + k * (2 * MOVE_S + HOLD_S + PAUSE_S) for k in range(len(presses))]
    downs = [round(1e9 * s) for s in starts]
    paths = tuple(held(dent, down) for dents, down in zip(presses, downs, strict=True) for dent in dents)
    seconds = LOCK_S + len(presses) * (2 * MOVE_S + HOLD_S + PAUSE_S)
    taken = Followed()
    with open_devices(bench) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = Scenario("others", paths, seconds)
        for _ in Session(rig, devices=devices, publisher=taken).run(seconds=seconds):
            pass
    return taken, [down + round(1e9 * MOVE_S) for down in downs]


def cases_of(recorded: Recorded) -> dict[str, Recorded]:
    """The same recording with less and less of it."""
    plan, presses = recorded.plan, recorded.presses
    assert presses is not None
    one = replace(plan, edges=False, press_depths_mm=plan.press_depths_mm[1:2])
    none = replace(plan, edges=False, press_depths_mm=())
    return {
        CASES[0]: recorded,
        CASES[1]: replace(recorded, plan=one, presses=PressWarps(presses.rest, presses.pressed[1:2])),
        CASES[2]: replace(recorded, plan=none, presses=None),
    }


@dataclass(frozen=True)
class BenchResult:
    """What one bench gave."""

    outcomes: tuple[Outcome, ...]
    facts: dict[str, Any]


def recorded_of(
    given: Rig, bench: Rig, known: Sequence[Dent], depths_mm: tuple[float, ...]
) -> tuple[Recorded, RestMeasurement, list[str]]:
    """Record a bench by one who believes `given`, pressed as asked; with the lines that were said."""
    plan = Plan(depths_mm, GAUGE_MM / np.sqrt(3), delay_s=1.5, patience_s=6.0)
    with open_devices(bench) as devices:
        hand = Hand(devices, known)
        recorded, found = record(given, devices, plan, hand)
    if recorded.failure:
        raise RuntimeError(f"{recorded.failure}: {hand.lines}")
    return recorded, found, hand.lines


def study_bench(
    number: int, tests: int = TESTS, cases: Sequence[str] = CASES, name: str = "simulated"
) -> BenchResult:
    """Draw, calibrate, run and read one bench."""
    started = time.process_time()
    rng = generator(7, number)
    given = nominal(name)
    bench = drawn(given, rng, seed(number))
    view = View(bench)
    known = [
        pad(*view.place(share, rng.uniform(0.4, 0.6)), KNOWN_MM, KNOWN_SIGMA_MM) for share in KNOWN_SHARES
    ]
    given_mm = tuple(dent.depth_mm + rng.uniform(-GAUGE_MM, GAUGE_MM) for dent in known)
    recorded, found, said = recorded_of(given, bench, known, given_mm)
    recorded_s = time.process_time() - started
    calibrated = {case: evaluate(one, found) for case, one in cases_of(recorded).items() if case in cases}
    fitted_s = time.process_time() - started - recorded_s
    kinds = tuple(k % 4 for k in range(tests))
    presses = [other_press(kind, view.place, rng) for kind in kinds]
    depths = np.array([true_peak_mm(Mirror(dents), *view.points.T) for dents in presses])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rest.npz"
        found.rest_map.save(file)
        rigs = {case: on_rest(one.rig, file) for case, one in calibrated.items()}
        taken, holds = followed(rigs[cases[0]], bench, presses)
        held_frames = [taken.between(at, at + round(1e9 * HOLD_S)) for at in holds]
        readings = [[peaks for _, peaks in held_frames]]
        readings += [_read_again(rigs[case], [warps for warps, _ in held_frames]) for case in cases[1:]]
    outcomes = [
        _outcome(number, case, kinds, calibrated[case], read, depths)
        for case, read in zip(cases, readings, strict=True)
    ]
    facts = {
        "latency_ms": 1e3 * bench.display.latency_s,
        "gamma": bench.display.gamma,
        "values": recorded.values,
        "frames": [len(peaks) for _, peaks in held_frames],
        "edges": [one.words for one in calibrated[cases[0]].edges],
        "depths_mm": depths.tolist(),
        "frame_errors_percent": [
            [round(100.0 * (one.depth_mm / depth - 1.0), 2) for one in peaks]
            for (_, peaks), depth in zip(held_frames, depths, strict=True)
        ],
        "known_error_um": [
            1e3 * (one.depth_mm - dent.depth_mm)
            for one, dent in zip(calibrated[cases[0]].peaks, known, strict=True)
        ],
        "said": said,
        "seconds": {"record": recorded_s, "fit": fitted_s, "whole": time.process_time() - started},
        "steps": recorded.seconds,
    }
    return BenchResult(tuple(outcomes), facts)


def on_rest(rig: Rig, file: Path) -> Rig:
    """The rig with the rest as measured."""
    return rig.model_copy(update={"camera": rig.camera.model_copy(update={"rest_map": file})})


def _outcome(
    number: int,
    case: str,
    kinds: tuple[int, ...],
    calibration: Calibration,
    readings: Sequence[Sequence[Peak]],
    depths: Float,
) -> Outcome:
    """Of the presses that the loop nulled for a frame at least."""
    nulled = [k for k, one in enumerate(readings) if one]
    kinds, depths = tuple(kinds[k] for k in nulled), depths[nulled]
    peaks = [_together(readings[k]) for k in nulled]
    read = np.array([one.depth_mm for one in peaks])
    places = (np.array([getattr(one, name) for one in peaks]) for name in ("x_mm", "y_mm"))
    geometry = 100.0 * calibration.rig.geometry.sigmas(*places)[0]
    sigmas = np.hypot(100.0 * np.array([one.sigma_mm for one in peaks]) / read, 0.05)
    errors = 100.0 * (read / depths - 1.0)
    chi2, settled = calibration.fitted.chi2_per_freedom, calibration.fitted.settled
    return Outcome(number, case, kinds, tuple(errors), tuple(sigmas), tuple(geometry), chi2, settled)


def _together(peaks: Sequence[Peak]) -> Peak:
    """Mean of frames of one press, weighted by their sigma, which counts as alike in all of them.

    Frames in which the loop hunts for a fold have a large one.
    """
    values = np.array([(one.depth_mm, one.x_mm, one.y_mm, one.sigma_mm) for one in peaks])
    weights = values[:, 3] ** -2.0
    depth_mm, x_mm, y_mm, sigma_mm = (float(column @ weights / weights.sum()) for column in values.T)
    return Peak(depth_mm, x_mm, y_mm, sigma_mm)


def _read_again(rig: Rig, frames: Sequence[Sequence[Warp]]) -> list[list[Peak]]:
    """Peaks of the same warps through another rig, as its run would read them."""
    optics = Optics(rig)
    reader = SurfaceReader(rig, optics, Rest.of(rig, optics).grid)
    return [[peak(reader.read(warp)) for warp in one] for one in frames]


def report(numbers: Sequence[int], jobs: int) -> Report:
    """Study benches, `jobs` at a time."""
    results: list[BenchResult] = []
    with progress(len(numbers), "benches") as bar:
        for result in _results(numbers, jobs):
            results.append(result)
            bar()
    outcomes = [one for result in results for one in result.outcomes]
    cases = {case: summarise(outcomes, case) for case in CASES}
    frames = [count for result in results for count in result.facts["frames"]]
    nulled = len(frames) - frames.count(0)
    read = figure(f"of {len(frames)} other presses: nulled", nulled, least=0.98, of_other=True)
    return Report(
        "Depth of other presses on benches calibrated by their own pictures",
        [*figures_of(outcomes, len(numbers)), read],
        details_of(cases),
        {
            "outcomes": [asdict(one) for one in outcomes],
            "cases": cases,
            "benches": [result.facts for result in results],
        },
    )


def _results(numbers: Sequence[int], jobs: int) -> Iterator[BenchResult]:
    if jobs <= 1:
        limit_threads()
        yield from map(study_bench, numbers)
        return
    # GL contexts and threads do not survive a fork
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=limit_threads) as pool:
        yield from pool.map(study_bench, numbers)


@benchmark(
    "calibration_benches",
    __doc__,
    click.option("--benches", type=Whole(min=1), help="How many benches.  [default: 10, --quick: 3]"),
    click.option("--jobs", type=Whole(min=1), default=1, show_default=True, help="Benches at a time."),
    salt_option,
)
def command(quick: bool, benches: int | None, jobs: int) -> Report:
    return report(range(benches or (3 if quick else 10)), jobs)


if __name__ == "__main__":
    start(command)
