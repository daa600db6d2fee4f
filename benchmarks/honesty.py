"""Whether a wrong number is ever called good: planted faults next to honest presses, on simulated benches.

The packaged bench with four times larger pixels; rig file and bench may differ, as a stranger's do. Honest
runs press loads of sigma 4 to 40 mm (2.4 nodes and more) and balls, all over the view and beyond, on a bench
that is as its rig file says and, as often, on four calibrated by this program. What folds or is too fine for
the LCD by the exact rays need not be good, but true and not named. Faulty ones turn the camera or slide the
LCD in mid-run, at rest and under a press, at once or slowly, or believe a geometry that is off by 0.1 to 5
sigma of calipers.

A run is judged frame by frame from the fault on. What a fault does is the error of the peak over its stated
sigma; a fault whose effect exceeds 3 must be named: within 10 frames of it the state is neither locked nor
resting. No honest run may be named. Nodes are counted in every frame that is called good. --rig printed is
read passively: there *passive* counts as locked. --rig thin has pixels twice as large, and presses less deep,
until its saw can null them; --rig interactive has pixels twice as large.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.calibration_benches import (
    KNOWN_SHARES,
    KNOWN_SIGMA_MM,
    View,
    drawn,
    nominal,
    on_rest,
    recorded_of,
)
from benchmarks.calibration_study import KNOWN_MM
from benchmarks.fault_tour import LIGHTS
from benchmarks.hand_presses import any_press, can_be_nulled, shallow_enough
from benchmarks.interactive import bench as interactive_bench
from benchmarks.pads import pad
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import changed, coarser
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import SIGMAS, Frame, estimate, few_beyond, frame_of, node_figures, rate, ratio, rms
from zeromethod.calibration import build, describe
from zeromethod.calibration.parameters import Priors
from zeromethod.cli.numbers import Whole
from zeromethod.commissioning.calibration import evaluate
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import TrueMirror
from zeromethod.errors import InputError
from zeromethod.loop.frame_outcome import BURST_AHEAD, BURST_WORDS, LAMP_AHEAD, LAMP_WORDS
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import Step
from zeromethod.optics import DepthField, check_geometry
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface import Peak, Surface

FAR_SIGMAS = 5.0
FRAMES_TO_NAME = 10
PRESS_AT, FAULT_AT, LAST, READ_BY = 12, 24, 48, 160
"""Frames at which the press and the fault come, the last one, and the last where coded pictures read on."""

GOOD = NULLED | {State.PASSIVE}
PRESSED = frozenset({State.LOCKED, State.PASSIVE})
EARLY = frozenset({State.NULLING, State.RESTING})
WAITS = frozenset({BURST_AHEAD, BURST_WORDS, LAMP_AHEAD, LAMP_WORDS})
SETTLED = 6
"""Frames after the press from which peaks are counted: the null has caught up."""

HONEST, HONEST_QUICK, BENCHES = 200, 12, 4
"""Honest presses, and the calibrated benches that see half of them: one draw of a calibration says little."""
CALIPERS = (0.1, 0.5, 1.0, 2.0, 5.0)
"""Sigmas of the priors by which an uncalibrated bench is off."""
SEED = 14
BEYOND = "honest, folds or too fine"


@dataclass(frozen=True)
class Case:
    """One run on a bench that truly stands as `bench`.

    fault_at: frame, None for an honest run. calibration: number of the one that `believed` comes from; None
    where it is as given.
    """

    kind: str
    bench: Rig
    believed: Rig
    dents: tuple[Dent, ...]
    fault_at: int | None = None
    calibration: int | None = None


@dataclass
class Outcome:
    """What came of a run.

    named: a frame from the fault on had a state that names one. effect: largest error of the peak over its
    sigma from the fault on, in frames called good or named. unnamed: the same of frames called good more than
    `FRAMES_TO_NAME` after the effect first passed `SIGMAS`. good: whether frame `LAST` was called good.
    read: the same of the last one, where coded pictures were to be waited for. errors, sigmas: of peaks
    called good, mm. early: error over sigma of peaks not yet nulled, or at rest, by state. nodes: of frames
    called good. frames, called: from the press to frame `LAST`, and those of them called good.
    """

    kind: str
    named: bool = False
    effect: float = 0.0
    unnamed: float = 0.0
    good: bool = False
    read: bool = False
    errors: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    early: dict[str, list[float]] = field(default_factory=dict)
    nodes: list[Frame] = field(default_factory=list)
    frames: int = 0
    called: int = 0


def pressed(rig: Rig, dents: Sequence[Dent]) -> Scenario:
    """Presses that all come at once, at frame `PRESS_AT`, and stay."""
    at_ns = round(1e9 * PRESS_AT / rig.camera.rate_hz)
    paths = [
        PressPath(d, tuple(PathPoint(at_ns, d.x_mm, d.y_mm, depth) for depth in (0.0, d.depth_mm)))
        for d in dents
    ]
    return Scenario("pressed", tuple(paths), 1e9)


def honest(benches: Sequence[tuple[Rig, int | None]], count: int) -> Iterator[Case]:
    """Honest presses, by turns on every bench; with the number of its calibration, None: known geometry."""
    draw = generator(SEED, 0)
    views = [View(bench) for bench, _ in benches]
    for number in range(count):
        bench, calibration = benches[number % len(benches)]
        name = "honest, known geometry" if calibration is None else "honest, calibrated"
        seeded = changed(bench, simulation={"seed": seed(number)})
        dents = any_press(views[number % len(benches)], draw)
        if bench.prism.teeth is not None:
            dents = shallow_enough(bench, dents)
        kind = name if can_be_nulled(bench, dents) else BEYOND
        yield Case(kind, seeded, bench, dents, calibration=calibration)


def middle_press(bench: Rig) -> Dent:
    """A press in the middle of the view, as deep as the bench nulls within the frames before a fault."""
    depth_mm = 0.15 if bench.prism.teeth is None else 0.05
    return pad(*View(bench).place(0.5, 0.5), depth_mm, 5.0, bench.rubber)


def turned_by_a_pixel_deg(bench: Rig) -> float:
    """Turn of the camera that moves the view by a pixel."""
    camera = bench.camera
    if camera.focal_px is not None:
        return float(np.degrees(1.0 / camera.focal_px[0]))
    assert camera.pixel_mm is not None
    away = np.subtract(camera.look_at_mm, camera.position_mm)
    return float(np.degrees(camera.pixel_mm / np.linalg.norm(away)))


def bumps(bench: Rig, believed: Rig) -> Iterator[Case]:
    """Camera and LCD moved in mid-run, at rest and under a press, at once and slowly."""
    pixel_deg, middle = turned_by_a_pixel_deg(bench), middle_press(bench)
    motions: list[tuple[str, Callable[[float], dict[str, Any]]]] = [
        ("pan", lambda px: {"camera_turned_deg": (px * pixel_deg, 0.0, 0.0)}),
        ("tilt", lambda px: {"camera_turned_deg": (0.0, px * pixel_deg, 0.0)}),
        ("roll", lambda px: {"camera_turned_deg": (0.0, 0.0, 400.0 * px * pixel_deg / bench.camera.columns)}),
        ("LCD slid along", lambda px: {"display_slid_mm": (0.6 * px * bench.display.pitch_mm, 0.0)}),
        ("LCD slid across", lambda px: {"display_slid_mm": (0.0, 0.6 * px * bench.display.pitch_mm)}),
    ]
    for name, motion in motions:
        for px in (0.1, 0.5, 2.0):
            for dents in ((), (middle,)):
                where = "under a press" if dents else "at rest"
                for over, how in ((0, "bump"), (18, "drift")):
                    faults = {"moved_at_frame": FAULT_AT, "moved_over_frames": over, **motion(px)}
                    moved = bench.replace(
                        {f"simulation.faults.{key}": value for key, value in faults.items()}
                    )
                    yield Case(f"{how}: {name} {px:g} px, {where}", moved, believed, dents, FAULT_AT)


def uncalibrated(believed: Rig) -> Iterator[Case]:
    """Benches off by some sigma of calipers in every parameter, by one who never calibrated."""
    priors, middle = Priors.of(believed), describe(believed)
    draw = generator(SEED, 1)
    dent = middle_press(believed)
    for sigmas in CALIPERS:
        for _ in range(20):
            away = sigmas * priors.sigma * draw.choice([-1.0, 1.0], len(priors.names))
            bench = build(believed, {n: middle[n] + a for n, a in zip(priors.names, away, strict=True)})
            try:
                check_geometry(bench)
                View(bench)
            except (InputError, ValueError):
                continue
            yield Case(f"never calibrated, {sigmas:g} sigma off", bench, believed, (dent,), 0)
            break


def bench_of(number: int) -> Rig:
    """A drawn bench."""
    return drawn(nominal(), generator(SEED, 2, number), seed(SEED + number))


def calibrated(folder: Path, number: int) -> Rig:
    """The rig that a calibration with three known presses makes of a drawn bench; kept in the folder."""
    kept = folder / f"calibrated{number}.json"
    if kept.exists():
        return Rig.model_validate_json(kept.read_text())
    given, bench = nominal(), bench_of(number)
    view = View(bench)
    known = [pad(*view.place(share, 0.5), KNOWN_MM, KNOWN_SIGMA_MM) for share in KNOWN_SHARES]
    recorded, found, _ = recorded_of(given, bench, known, (KNOWN_MM,) * len(known))
    rest_map = folder / f"rest{number}.npz"
    found.rest_map.save(rest_map)
    rig = on_rest(evaluate(recorded, found).rig, rest_map)
    kept.write_text(rig.model_dump_json(exclude_unset=True))
    return rig


def judged(case: Case) -> Outcome:
    """Run a case and hold every reading against the truth at its own place."""
    out = Outcome(case.kind)
    passed: int | None = None
    waits = False
    with open_devices(case.bench) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = pressed(case.bench, case.dents)
        with Session(case.believed, devices=devices) as session:
            for step in session.run(frames=READ_BY):
                frame, peak = step.frame_number, step.peak
                out.frames += (frame or 0) > PRESS_AT and step.number <= LAST
                if step.number > LAST and not waits:
                    break
                waits = step.reason in WAITS or (waits and step.state is State.NULLING)
                if frame is None or peak is None or step.surface is None:
                    continue
                good, named = step.state in GOOD, step.state in {State.MOVED, State.UNCALIBRATED}
                mirror = camera.truth(step.time_ns)
                error_mm, sigma_mm, ratio = deviation(step, mirror)
                if good:
                    out.nodes += nodes_of(step.surface, mirror, pressed=frame > PRESS_AT)
                    out.called += frame > PRESS_AT and step.number <= LAST
                    if step.state in PRESSED and frame > PRESS_AT + SETTLED:
                        out.errors.append(error_mm)
                        out.sigmas.append(sigma_mm)
                if case.fault_at is None and step.state in EARLY and frame not in (PRESS_AT - 1, PRESS_AT):
                    out.early.setdefault(step.state.value, []).append(ratio)
                out.good, out.read = good if step.number <= LAST else out.good, good
                if case.fault_at is None or frame >= case.fault_at:
                    out.named |= named
                    out.effect = max(out.effect, ratio if good or named else 0.0)
                    passed = frame if passed is None and good and ratio > SIGMAS else passed
                    late = passed is not None and frame > passed + FRAMES_TO_NAME
                    out.unnamed = max(out.unnamed, ratio if good and late else 0.0)
    return out


def nodes_of(surface: Surface, mirror: TrueMirror, *, pressed: bool) -> list[Frame]:
    """A frame's nodes, if it has any, against what is stated of depth and of their place."""
    valid = surface.valid & np.isfinite(surface.sigma_depth_mm)
    true_mm = mirror.depth(surface.x_mm[valid], surface.y_mm[valid])
    error_mm = surface.depth_mm[valid] - true_mm
    place = np.stack([surface.sigma_x_mm[valid], surface.sigma_y_mm[valid]], axis=-1)
    by_place = (surface.slope[valid] * place) ** 2
    sigma_mm = np.sqrt(surface.sigma_depth_mm[valid] ** 2 + by_place.sum(axis=-1))
    return [frame_of(error_mm, sigma_mm, pressed=pressed)] if valid.any() else []


def deviation(step: Step, mirror: TrueMirror) -> tuple[float, float, float]:
    """Error (mm) of a reading's peak at its place; its sigma, with the place's by the slope; their ratio."""
    assert step.peak is not None
    assert step.surface is not None
    x, y = np.array(step.peak.x_mm), np.array(step.peak.y_mm)
    error_mm = step.peak.depth_mm - float(mirror.depth(x, y))
    sigma_mm = math.hypot(step.peak.sigma_mm, by_place_mm(step.surface, step.peak, mirror))
    return error_mm, sigma_mm, abs(error_mm) / sigma_mm


def by_place_mm(surface: Surface, peak: Peak, mirror: DepthField) -> float:
    """What a peak's depth may be off because its place is: nothing on a summit, much on a flank cut off."""
    away = np.hypot(surface.x_mm - peak.x_mm, surface.y_mm - peak.y_mm)
    node = np.unravel_index(int(np.argmin(away)), away.shape)
    slope = mirror.slope(np.array(peak.x_mm), np.array(peak.y_mm))
    return math.hypot(
        *(
            float(s) * float(one[node])
            for s, one in zip(slope, (surface.sigma_x_mm, surface.sigma_y_mm), strict=True)
        )
    )


def bench_by_name(name: str) -> Rig:
    """Packaged rig with larger pixels, and nothing that presses; cloth has threads as much wider."""
    if name == "interactive":
        rig = interactive_bench("pointers")
    else:
        rig = coarser(load_rig(name), 2 if name == "thin" else 4)
    return changed(rig, simulation={"seed": seed(0)}).model_copy(update={"scenario": "none"})


def report(count: int, *, faults: bool, parts: Parts, light: str = "lcd", name: str = "simulated") -> Report:
    """Run `count` honest presses, and all faults, or those of them that are still missing in `parts`.

    light: one of `LIGHTS`. name: a packaged rig. With others than the LCD alone and the packaged bench the
    bench is that of the rig file.
    """
    known = bench_by_name(name)
    with parts.folder() as folder:
        calibrate = functools.cache(functools.partial(calibrated, folder))
        benches: list[tuple[Rig, int | None]] = []
        for number in range(BENCHES if (light, name) == ("lcd", "simulated") else 0):
            benches += [(known, None), (bench_of(number), number)]
        cases = list(honest(benches or [(known, None)], count))
        if faults:
            cases += [*bumps(known, known), *uncalibrated(known)]

        def run(number: int) -> dict[str, Any]:
            case = cases[number]
            if case.calibration is not None:
                case = replace(case, believed=calibrate(case.calibration))
            lit = case.bench.replace(LIGHTS[light]) if LIGHTS[light] else case.bench
            return asdict(judged(replace(case, bench=lit)))

        return summarise([Outcome(**kept) for kept in parts.run(len(cases), "runs", run)])


def summarise(outcomes: Sequence[Outcome]) -> Report:
    """Bars over all runs, and a line for each kind."""
    fair = [one for one in outcomes if one.kind.startswith("honest")]
    faulty = [one for one in outcomes if not one.kind.startswith("honest")]
    z = [one.errors[-1] / one.sigmas[-1] for one in fair if one.errors]
    missed = [one for one in faulty if one.unnamed > SIGMAS]
    named = [one for one in fair if one.named]
    drawable = [(one.good, one.read) for one in fair if one.kind != BEYOND]
    good, read = np.sum(drawable, axis=0) if drawable else (0, 0)
    frames = estimate(ratio, [one.called for one in fair], [one.frames for one in fair])
    far = int(np.sum(np.abs(z) > FAR_SIGMAS))
    figures = [
        figure(
            f"of {len(faulty)} faults: an effect over 3 sigma called good 10 frames on", len(missed), most=0
        ),
        figure("honest presses named as a fault", *rate(len(named), len(fair)), unit="%", most=0.01),
        figure("honest presses called good at the end", *rate(good, len(drawable)), unit="%", least=0.95),
        Figure("the same once coded pictures have read what none nulls", f"{read} of {len(drawable)}"),
        figure("frames of honest presses called good", *frames, unit="%", least=0.98, of_other=True),
        few_beyond("honest peaks", z),
        Figure("honest peaks beyond 5 sigma", f"{far}", "0", far == 0),
        *(
            few_beyond(f"peaks while {state}", [z for one in fair for z in one.early.get(state, ())])
            for state in sorted(one.value for one in EARLY)
        ),
        *node_figures([one.nodes for one in outcomes], [one.nodes for one in fair]),
        figure("honest peaks: error over sigma, rms", *estimate(rms, z)),
    ]
    details = [["run", "runs", "named", "good at the end", "effect, sigma", "unnamed, sigma", "nodes beyond"]]
    for kind in dict.fromkeys(one.kind for one in outcomes):
        mine = [one for one in outcomes if one.kind == kind]
        nodes = [frame for one in mine for frame in one.nodes]
        details.append(
            [
                kind,
                f"{len(mine)}",
                f"{sum(one.named for one in mine)}",
                f"{sum(one.good for one in mine)}",
                f"{max(one.effect for one in mine):.1f}",
                f"{max(one.unnamed for one in mine):.1f}",
                f"{sum(frame[2] for frame in nodes) / sum(frame[1] for frame in nodes):.2%}" if nodes else "",
            ]
        )
    data = {"runs": [asdict(one) for one in outcomes]}
    return Report("Whether a wrong number is called good", figures, details, data)


@benchmark(
    "honesty",
    __doc__,
    click.option("--presses", type=Whole(min=2), default=HONEST, show_default=True, help="Honest presses."),
    click.option("--faults/--no-faults", default=True, help="Plant the faults, too."),
    click.option("--light", type=click.Choice(list(LIGHTS)), default="lcd", help="What else shines."),
    click.option(
        "--rig",
        "name",
        type=click.Choice(["simulated", "printed", "thin", "interactive"]),
        default="simulated",
        help="The bench.",
    ),
    part_options,
    salt_option,
)
def command(
    quick: bool, presses: int, faults: bool, light: str, name: str, keep: Path | None, most_runs: int | None
) -> Report:
    """Run everything."""
    count = HONEST_QUICK if quick else presses
    lit = {} if light == "lcd" else {"light": light}
    lit |= {} if name == "simulated" else {"rig": name}
    parts = Parts(keep, most_runs, presses=count, **lit)
    return report(count, faults=faults, parts=parts, light=light, name=name)


if __name__ == "__main__":
    start(command)
