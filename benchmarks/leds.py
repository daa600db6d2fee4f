"""LED and photodetector arrays: noise, accuracy, lock, resolution, dead channels, speed; faults; honesty.

The packaged rig `leds`, simulated: 5 kHz, 1e-3 of full scale of noise in each reading, gains that differ by
5 % from channel to channel, one frame of delay. Presses are Gaussian dents with their images in the frame.
Errors are those of single readings at 1 kHz, of five frames each, while locked.

bars: presses of sigma 6 to 10 mm that jump to 0.1 and 0.2 mm; two dents of sigma 5 mm 15 mm apart; a tenth of
LEDs and of detectors dead. faults: channels that die, saturate or drift, readings that are lost, light that
changes, each planted at rest; named, recovered, and read true under a press behind it. honesty: one dent or
two, of sigma 2 to 12 mm, 1 to 100 µm deep, anywhere in view, the detectors turned by up to 2 mrad.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import click
import numpy as np

from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.salt import generator, salt_option, seed
from zeromethod.arrays import Float
from zeromethod.light_array.loop import LightLoop
from zeromethod.light_array.recording import PlayedArrays
from zeromethod.light_array.rig import LightArrayRig, load_light_array
from zeromethod.light_array.simulated import SimulatedArrays
from zeromethod.loop.state import NULLED, State
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape
from zeromethod.simulation.scenario import Scenario

PRESS_S, END_S, SETTLED_S = 0.05, 0.12, 0.004
SIGMAS = 3.0
WATCH = (42.0, 0.0)
_SCENES, _EVERY_S, _PRESSED_S = 10, 0.06, 0.04
_NEVER_REST_MM = 0.005
Place = tuple[float, float, float, float]
"""x, y, sigma and depth of a dent, mm."""


@dataclass
class Run:
    """What a run left. errors: (n, 3) peak's, over the true one; in its sigmas; rms over the view, mm."""

    lock_s: float = np.nan
    errors: list[tuple[float, float, float]] = field(default_factory=list)
    untouched: list[Float] = field(default_factory=list)
    good: int = 0
    nodes: int = 0
    nodes_beyond: int = 0
    faults: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    states: set[State] = field(default_factory=set)
    last: Float | None = None
    end: State = State.STARTING


def packaged(**simulation: Any) -> LightArrayRig:
    """The packaged rig with values of [simulation]."""
    rig = load_light_array("leds")
    assert rig is not None
    return rig.changed(simulation=simulation)


def pressed(dents: list[Place], at_s: float = PRESS_S) -> Scenario:
    """Dents that are there from one instant on."""
    paths = []
    for x, y, sigma, depth in dents:
        ns = round(1e9 * at_s)
        path = (PathPoint(ns, x, y, 0.0), PathPoint(ns, x, y, depth))
        paths.append(PressPath(Dent(Shape.GAUSSIAN, x, y, depth, sigma), path))
    return Scenario("benchmark", tuple(paths), END_S)


def run(rig: LightArrayRig, scenario: Scenario, end_s: float = END_S, every: int = 1) -> Run:
    """Run a scene to its end, and compare every so many-th reading under the press with the truth."""
    arrays = SimulatedArrays(rig)
    arrays.scenario = scenario
    loop, out, count = LightLoop(rig, arrays), Run(), 0
    press_s = min((path.points[0].time_ns for path in scenario.presses), default=10**12) * 1e-9  # type: ignore[attr-defined]
    for step in loop.run():
        at_s = 1e-9 * arrays.scenario_ns(step.time_ns)
        out.states.add(step.state)
        if at_s >= press_s and np.isnan(out.lock_s) and step.state is State.LOCKED:
            out.lock_s = at_s - press_s
        if step.modes is not None and step.state in NULLED and step.peak is not None:
            if at_s < press_s:
                out.untouched.append(loop.reader.depth_of(step.modes[None])[0])
            elif at_s >= press_s + SETTLED_S:
                count += 1
                out.good += 1
                if count % every == 0:
                    compare(loop, arrays, step, out)
        if at_s >= end_s:
            break
    out.faults, out.counts, out.end = loop.faults, dict(loop.counts), loop.state
    return out


def compare(loop: LightLoop, arrays: SimulatedArrays, step: Any, out: Run) -> None:
    """Enter the error of one reading."""
    x, y, depth = loop.reader.depth_map(step.modes)
    out.last = depth
    mirror = arrays.true_mirror(step.time_ns)
    true, peak = mirror.field(*np.meshgrid(x, y))[0], mirror.peak(x, y)
    error = step.peak.depth_mm - peak
    rms = float(np.sqrt(np.mean((depth - true) ** 2)))
    out.errors.append((error / (abs(peak) or np.inf), error / step.peak.sigma_mm, rms))
    if step.surface is not None:
        surface = step.surface
        there = arrays.true_mirror(step.time_ns).field(surface.x_mm, surface.y_mm)[0]
        out.nodes += there.size
        out.nodes_beyond += int(np.sum(np.abs(surface.depth_mm - there) > SIGMAS * surface.sigma_depth_mm))


def computing_hz() -> float:
    """Frames a second of one core, by processor time, of a press that comes and is read; median of three."""
    rig = packaged()
    arrays = SimulatedArrays(rig)
    arrays.scenario = pressed([(*WATCH, 6.0, 0.2)])
    rows: list[tuple[Any, ...]] = []

    def record(name: str, *row: Any) -> None:
        if name == "readings":
            rows.append(row)

    for _ in LightLoop(rig, arrays, record).run(frames=1000):
        pass
    kind = [("number", "<u8"), ("shown", "<u8"), ("time_ns", "<i8"), ("counts", "<u2", 256)]
    readings = np.array(rows, kind)
    rates = []
    for _ in range(3):
        steps = LightLoop(rig, PlayedArrays(readings)).run(frames=1000)
        next(steps)
        began = time.process_time()
        frames = sum(1 for _ in steps)
        rates.append(frames / (time.process_time() - began))
    return float(np.median(rates))


def bars(quick: bool) -> tuple[list[Figure], dict[str, Any]]:
    """The figures with bars."""
    places = [(42.0, 0.0), (36.0, 4.0), (48.0, -5.0), (30.0, 6.0), (54.0, 5.0)]
    cases = [(x, y, sigma, depth) for x, y in places for sigma in (6.0, 8.0, 10.0) for depth in (0.1, 0.2)]
    cases = cases[1::3] if quick else cases
    runs = [run(packaged(seed=seed(k)), pressed([case])) for k, case in enumerate(cases)]
    peaks = np.array([max(abs(error[0]) for error in one.errors) if one.errors else np.inf for one in runs])
    locks = np.array([one.lock_s if np.isfinite(one.lock_s) else np.inf for one in runs])
    noise = float(np.sqrt(np.mean(np.concatenate([np.ravel(one.untouched) for one in runs]) ** 2)))
    apart = [
        told_apart([(42 - dx, -dy, 5.0, 0.1), (42 + dx, dy, 5.0, 0.1)]) for dx, dy in ((7.5, 0.0), (4.5, 6.0))
    ]
    rng = generator(7)
    dead = {name: tuple(rng.permutation(256)[:26].tolist()) for name in ("dead_leds", "dead_detectors")}
    with_all, with_dead = (
        [
            run(packaged(seed=seed(k), fault_s=-10.0, **given), pressed([(x, y, 6.0, 0.1)]))
            for k, (x, y) in enumerate(places)
        ]
        for given in ({}, dead)
    )
    named = min(len(one.faults) for one in with_dead)
    cost = [float(np.median([e[2] for one in some for e in one.errors])) for some in (with_all, with_dead)]
    hz = computing_hz()
    figures = [
        figure("frames a second of one core, by processor time", hz, least=3500),
        figure("lock after a step, slowest", 1e3 * locks.max(), unit="ms", most=3.0),
        figure("error of the peak, worst reading", peaks.max(), unit="%", most=0.025),
        figure("depth noise at 1 kHz, rms over the view", 1e3 * noise, unit="µm", most=0.3),
        Figure("two presses 15 mm apart told apart", f"{sum(apart)} of {len(apart)}", "all", all(apart)),
        Figure("dead channels named, least of 52", str(named), "52", named == 52),
        Figure(
            "depth error with a tenth dead, over without",
            f"{cost[1] / cost[0]:.2f}",
            "2",
            cost[1] <= 2 * cost[0],
        ),
    ]
    data = {"cases": cases, "peaks": peaks.tolist(), "locks_s": locks.tolist(), "rms_mm": cost}
    return figures, data


def told_apart(dents: list[Place]) -> bool:
    """Whether the last reading has two maxima, each within 1.5 mm of a dent's place."""
    out = run(packaged(), pressed(dents))
    rig = packaged()
    loop_x, loop_y, _ = LightLoop(rig, SimulatedArrays(rig)).reader.depth_map(np.zeros(rig.reading.modes))
    depth = out.last
    if depth is None:
        return False
    inner = depth[1:-1, 1:-1]
    around = [
        depth[1 + a : depth.shape[0] - 1 + a, 1 + b : depth.shape[1] - 1 + b]
        for a in (-1, 0, 1)
        for b in (-1, 0, 1)
    ]
    rows, cols = np.nonzero((inner >= np.max(around, axis=0)) & (inner > 0.05))
    found = [(loop_x[c + 1], loop_y[r + 1]) for r, c in zip(rows, cols, strict=True)]
    return len(found) == 2 and all(
        min(np.hypot(fx - x, fy - y) for fx, fy in found) < 1.5 for x, y, _, _ in dents
    )


FAULTS: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("none", {}, ""),
    ("detector dies", {"dead_detectors": (100,)}, "detector 100 is dead"),
    ("detector saturates", {"saturated_detectors": (37,)}, "detector 37 is saturated"),
    (
        "detector drifts 5 % a second",
        {"drifting_detectors": (150,), "drift_per_s": -0.05},
        "detector 150 is drifting",
    ),
    ("LED dies", {"dead_leds": (119,)}, "LED 119 is dead"),
    ("LED drifts 5 % a second", {"drifting_leds": (120,), "drift_per_s": -0.05}, "LED 120 is drifting"),
    ("3 detectors and 2 LEDs die", {"dead_detectors": (5, 90, 91), "dead_leds": (60, 200)}, "LED 60 is dead"),
    ("50 readings lost", {"lose_frames": tuple(range(2600, 2650))}, "readings lost"),
    ("stall of 1.5 s", {"stall_at_frame": 2600, "stall_s": 1.5}, "times without readings"),
    ("light from outside, 5 % of full scale", {"ambient": 0.05}, ""),
    ("LEDs 10 % darker", {"brightness": 0.9}, ""),
)
"""Name, values of [simulation], and what the run must say."""


def faults(quick: bool) -> tuple[list[Figure], list[list[str]], dict[str, Any]]:
    """Each fault at rest, 0.02 s into the scene; a press behind it."""
    rows, missed, worst = [["fault", "said", "end", "peak, worst", "left out"]], 0, 0.0
    for name, values, said in FAULTS[:: 2 if quick else 1]:
        late = 0.4 if "drift" in name else 0.1
        out = run(packaged(fault_s=0.02, **values), pressed([(*WATCH, 6.0, 0.1)], late), late + 0.05)
        error = max((abs(e[0]) for e in out.errors), default=np.inf)
        wrong = set(out.faults) - set(_channels(values))
        ok = (not said or said in out.counts) and out.end in NULLED and error < 0.02 and not wrong
        missed += not ok
        worst = max(worst, error)
        named = "yes" if not said or said in out.counts else "NO"
        rows.append([name, named, out.end.value, f"{100 * error:.2f} %", ", ".join(out.faults)])
    count = len(rows) - 1
    figures = [
        Figure("faults named and survived", f"{count - missed} of {count}", "all", missed == 0),
        Figure("peak behind a fault, worst reading called good", f"{100 * worst:.2f} %", "2 %", worst < 0.02),
    ]
    return figures, rows, {"rows": rows}


def _channels(values: dict[str, Any]) -> list[str]:
    """Channels that a fault may have left out."""
    names = []
    for key, numbers in values.items():
        if key.endswith(("leds", "detectors")):
            names += [f"{'LED' if key.endswith('leds') else 'detector'} {k}" for k in numbers]
    return names


def honesty(quick: bool) -> tuple[list[Figure], dict[str, Any]]:
    """Random dents, ten scenes after each start; what is called good against the truth."""
    rng = generator(11)
    starts = 4 if quick else 40
    kinds: list[dict[str, Any]] = []
    nodes = nodes_beyond = rested = 0
    for k in range(starts):
        turned = float(rng.choice([0.0, 0.0, 0.5, 2.0]))
        rig, scenes = packaged(seed=seed(k), turned_mrad=turned), [random_dents(rng) for _ in range(_SCENES)]
        arrays = SimulatedArrays(rig)
        arrays.scenario = in_turn(scenes)
        loop, outs, after = LightLoop(rig, arrays), [Run() for _ in scenes], _EVERY_S - _PRESSED_S
        for step in loop.run(seconds=rig.simulation.begin_s + _SCENES * _EVERY_S):
            number, at_s = divmod(1e-9 * arrays.scenario_ns(step.time_ns) - after, _EVERY_S)
            if not 0 <= number < _SCENES or not SETTLED_S <= at_s < _PRESSED_S:
                continue
            out = outs[int(number)]
            out.states.add(step.state)
            deep = max(abs(dent[3]) for dent in scenes[int(number)])
            rested += step.state is State.RESTING and deep > _NEVER_REST_MM
            if step.modes is not None and step.peak is not None and step.state in NULLED:
                compare(loop, arrays, step, out)
        nodes += sum(out.nodes for out in outs)
        nodes_beyond += sum(out.nodes_beyond for out in outs)
        for dents, out in zip(scenes, outs, strict=True):
            states = sorted(state.value for state in out.states)
            kinds.append(
                {
                    "dents": dents,
                    "turned": turned,
                    "errors": out.errors,
                    "states": states,
                    "beyond": out.nodes_beyond,
                }
            )
    z = np.array([error[1] for one in kinds for error in one["errors"]])
    share, of_nodes = float(np.mean(np.abs(z) > SIGMAS)), nodes_beyond / max(nodes, 1)
    good = sum(bool(one["errors"]) for one in kinds)
    lost = sum(State.LOST.value in one["states"] for one in kinds)
    figures = [
        Figure("random scenes with readings called good; with *lost*", f"{good}; {lost} of {len(kinds)}"),
        Figure("their peaks beyond 3 sigma", f"{100 * share:.2f} %", "0.5 %", share <= 0.005),
        Figure(
            "error of the peak over its sigma, rms; worst",
            f"{np.sqrt(np.mean(z**2)):.2f}; {abs(z).max():.1f}",
        ),
        Figure("frames called resting over dents deeper than 5 µm", str(rested), "0", rested == 0),
        Figure(
            "places on maps called good beyond 3 sigma", f"{100 * of_nodes:.2f} %", "0.5 %", of_nodes <= 0.005
        ),
    ]
    return figures, {"scenes": kinds}


def random_dents(rng: np.random.Generator) -> list[Place]:
    """One dent, or two, of sigma 2 to 12 mm, 1 to 100 µm deep."""
    return [
        (rng.uniform(20, 64), rng.uniform(-14, 14), rng.uniform(2, 12), float(10 ** rng.uniform(-3, -1)))
        for _ in range(rng.integers(1, 3))
    ]


def in_turn(scenes: list[list[Place]]) -> Scenario:
    """Scenes that are there one after the other, each for a while after some rest."""
    paths = []
    for k, dents in enumerate(scenes):
        ends = [round(1e9 * (k * _EVERY_S + at)) for at in (_EVERY_S - _PRESSED_S, _EVERY_S)]
        for x, y, sigma, depth in dents:
            points = [
                PathPoint(ns, x, y, d)
                for ns, jump in zip(ends, ((0, depth), (depth, 0)), strict=True)
                for d in jump
            ]
            paths.append(PressPath(Dent(Shape.GAUSSIAN, x, y, depth, sigma), tuple(points)))
    return Scenario("benchmark", tuple(paths), len(scenes) * _EVERY_S)


PART = click.option(
    "--part", type=click.Choice(["bars", "faults", "honesty", "all"]), default="all", show_default=True
)


@benchmark("leds", __doc__, PART, salt_option)
def command(quick: bool, part: str) -> Report:
    figures: list[Figure] = []
    details: list[list[str]] = []
    data: dict[str, Any] = {}
    if part in {"bars", "all"}:
        found, data["bars"] = bars(quick)
        figures += found
    if part in {"faults", "all"}:
        found, details, data["faults"] = faults(quick)
        figures += found
    if part in {"honesty", "all"}:
        found, data["honesty"] = honesty(quick)
        figures += found
    return Report("LED and photodetector arrays, simulated, 16x16, 5 kHz", figures, details, data)


if __name__ == "__main__":
    start(command)
