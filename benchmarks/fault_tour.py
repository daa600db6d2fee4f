"""Every fault that the simulated bench can plant, one at a time: named, survived, never read wrong.

Camera and LCD binned by 4, a press of 0.2 mm (sigma 5 mm). Every fault is planted twice: while the press is
held, and while it jumps from 0.2 to 0.12 mm behind the fault's back. Named: the event that the run gave it.
Recovered: the last frames are locked again and within the bar (or, where nothing can be done, the run ended
in `fault` with its reason). Wrong by: the worst depth peak against the truth at mid-exposure among all
readings that the run offered as good, that is with a measurement and in state locked, passive or resting; of
frames exposed while the press jumps no truth is one number, and they do not count. Bar: 1 %;
the bench itself is 0.1 % off without any fault, as its nodes are four times as far apart as those of the
packaged rig. --light has the same bench under another light. --rig printed, a print under a lamp, is read
passively and has no display to lose; its pixels are twice as large only, and its bar is a passive sensor's
1.5 %, as its window hides a part of the press.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import click
import numpy as np

from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, coarser, opened, pressed
from zeromethod.devices.protocols import TrueMirror
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig
from zeromethod.surface import SurfaceReader, peak
from zeromethod.surface.comparison import true_peak_mm
from zeromethod.view.progress import progress

PRESS_S = 0.15
FAULT_FRAME = 28
FRAMES_AFTER = 40
DEPTH_MM, CHANGED_MM = 0.2, 0.12
WITHIN_PERCENT = 1.0
GOOD = {State.LOCKED, State.RESTING, State.PASSIVE}
MIDDLES_MM = {"simulated": VIEW_MIDDLE_MM, "contactless": 62.0, "thin": 38.0, "printed": VIEW_MIDDLE_MM}
"""x of the mirror point pressed, in the middle of a rig's view or, of a saw, on a seam."""
SHARES, BINNING, PERCENTS = {"thin": 0.5}, {"thin": 2, "printed": 2}, {"printed": 1.5}
"""Depth over that of the others; how many pixels become one where it is not four: a tooth needs nodes; bars
where they are not `WITHIN_PERCENT`."""
LIGHTS: dict[str, dict[str, Any]] = {
    "lcd": {},
    "mains": {"light.mains": 1.0},
    "sun": {"light.sun": 1.0},
    "ring": {"light.ring": 0.3},
}


@dataclass(frozen=True)
class Fault:
    """A planted fault, what it must be called, and whether the run can go on after it.

    changes_after: frames after the first faulty one at which the press jumps in the second scenario.
    """

    name: str
    keys: dict[str, Any]
    event: Event
    recovers: bool = True
    changes_after: float = 0.2


F = FAULT_FRAME
FAULTS = (
    Fault("none", {}, Event.PICTURES_MIXED),
    Fault("one frame dropped", {"drop_frames": (F,)}, Event.FRAMES_DROPPED),
    Fault(
        "five frames dropped",
        {"drop_frames": tuple(range(F, F + 5))},
        Event.FRAMES_DROPPED,
        changes_after=2.2,
    ),
    Fault("frame repeated", {"repeat_frames": (F,)}, Event.FRAME_REPEATED),
    Fault("frame late", {"late_frames": (F,), "late_s": 0.05}, Event.FRAME_LATE),
    Fault("frame torn", {"torn_frames": (F,)}, Event.FRAME_TORN),
    Fault("three frames torn", {"torn_frames": (F, F + 1, F + 2)}, Event.FRAME_TORN),
    Fault("stall of 1.5 s", {"stall_at_frame": F, "stall_s": 1.5}, Event.CAMERA_TIMEOUT, changes_after=30.0),
    Fault("stall of 5 s", {"stall_at_frame": F, "stall_s": 5.0}, Event.CAMERA_STALLED, changes_after=30.0),
    Fault(
        "camera lost, back after 1 s",
        {"camera_lost_at_frame": F, "camera_back_after_s": 1.0},
        Event.CAMERA_LOST,
        changes_after=30.0,
    ),
    Fault("camera lost for good", {"camera_lost_at_frame": F}, Event.CAMERA_LOST, recovers=False),
    Fault("display lost", {"display_lost_at_show": F}, Event.DISPLAY_LOST, recovers=False),
    Fault("light off for one frame", {"light_off_frames": (F, F)}, Event.LIGHT_OFF),
    Fault("light off for ten frames", {"light_off_frames": (F, F + 9)}, Event.LIGHT_OFF, changes_after=4.2),
)


@dataclass(frozen=True)
class Outcome:
    """What a run with a fault came to; errors of the depth peak in percent of the true one."""

    fault: str
    moving: bool
    named: bool
    events: list[str]
    states: list[str]
    reasons: list[str]
    end: str
    recovered: bool
    frames_to_recover: int | None
    worst_good_percent: float
    worst_any_percent: float
    good_readings: int


def peak_error_percent(read_mm: float, truth: TrueMirror, at: tuple[float, float]) -> float:
    """Peak read against the true one."""
    true_mm = true_peak_mm(truth, np.array([at[0]]), np.array([at[1]]))
    return 100 * (read_mm - true_mm) / true_mm


def tour(
    fault: Fault, moving: bool, frames_after: int = FRAMES_AFTER, light: str = "lcd", name: str = "simulated"
) -> Outcome:
    """Run one fault under a light, on a rig by name; the run goes on for so many frames after it."""
    rig = coarser(load_rig(name), BINNING.get(name, 4)).replace(LIGHTS[light])
    simulation = rig.simulation
    fault_s = (simulation.camera_phase + FAULT_FRAME) / rig.camera.rate_hz
    jump_s = fault_s + fault.changes_after / rig.camera.rate_hz
    deep_mm, changed_mm = (SHARES.get(name, 1.0) * depth_mm for depth_mm in (DEPTH_MM, CHANGED_MM))
    path = [(PRESS_S, 0.0), (PRESS_S, deep_mm)]
    if moving:
        path += [(jump_s, deep_mm), (jump_s, changed_mm)]
    rig = changed(rig, simulation={"faults": fault.keys})
    events: list[str] = []
    states: list[str] = []
    reasons: list[str] = []
    good_errors: list[float] = []
    any_errors: list[float] = []
    good_since: int | None = None
    count = 0
    with pressed(rig, path, at_mm=(MIDDLES_MM[name], 0.0)) as ready, opened(ready) as bench:
        reader = SurfaceReader(ready, bench.optics, bench.loop.grid)
        for step in bench.loop.run(frames=FAULT_FRAME + frames_after):
            after = (step.frame_number is None or step.frame_number >= FAULT_FRAME) and step.number > F // 2
            events += [str(e) for e in step.events if after and str(e) not in events]
            if after and (not states or states[-1] != step.state):
                states.append(str(step.state))
                if step.state not in GOOD and step.reason not in reasons:
                    reasons.append(step.reason)
            count += after
            error = float("nan")
            # a frame exposed while the press jumps shows the mean of two depths
            mixed = moving and abs(step.time_ns - 1e9 * jump_s) < 0.5e9 * ready.camera.exposure_s
            late_enough = step.time_ns > 1e9 * (PRESS_S + ready.camera.exposure_s)
            if step.measured is not None and late_enough and not mixed:
                found = peak(reader.read(step.measured))
                error = peak_error_percent(
                    found.depth_mm, bench.truth(step.time_ns), (found.x_mm, found.y_mm)
                )
                any_errors.append(error)
            good = step.state in GOOD
            if good and np.isfinite(error):
                good_errors.append(error)
            good_since = (good_since or count) if good and after else None
        end = f"{bench.loop.status.state}: {bench.loop.status.reason}"
        final = step.state
    ok = final in GOOD and bool(good_errors) and abs(good_errors[-1]) < PERCENTS.get(name, WITHIN_PERCENT)
    if not fault.recovers:
        ok = final is State.FAULT and bool(bench.loop.status.reason)
    return Outcome(
        fault=fault.name,
        moving=moving,
        named=str(fault.event) in events or not fault.keys,
        events=events,
        states=states,
        reasons=reasons,
        end=end,
        recovered=ok,
        frames_to_recover=good_since if fault.recovers else None,
        worst_good_percent=_largest(good_errors),
        worst_any_percent=_largest(any_errors),
        good_readings=len(good_errors),
    )


def _largest(errors: list[float]) -> float:
    return max(errors, key=abs) if errors else float("nan")


def measure(
    faults: tuple[Fault, ...],
    scenarios: tuple[bool, ...] = (False, True),
    light: str = "lcd",
    name: str = "simulated",
) -> Report:
    """Tour these faults under a light, on a rig by name; scenarios: press held, press jumping meanwhile."""
    if name == "printed":
        faults = tuple(fault for fault in faults if fault.event is not Event.DISPLAY_LOST)
    within = PERCENTS.get(name, WITHIN_PERCENT)
    outcomes = []
    with progress(len(faults) * len(scenarios), "faults") as bar:
        for fault in faults:
            for moving in scenarios:
                if moving and not fault.recovers:
                    continue
                outcomes.append(tour(fault, moving, light=light, name=name))
                bar()
    header = ["fault", "press", "named", "ends", "wrong, good", "wrong, any", "states after it", "events"]
    rows = [
        [
            o.fault,
            "jumps" if o.moving else "held",
            "yes" if o.named else "NO",
            "well" if o.recovered else "BADLY",
            f"{o.worst_good_percent:+.3f} %",
            f"{o.worst_any_percent:+.2f} %",
            " > ".join(o.states),
            ", ".join(o.events),
        ]
        for o in outcomes
    ]
    worst = max((o.worst_good_percent for o in outcomes), key=lambda e: np.nan_to_num(abs(e), nan=np.inf))
    unnamed = [o.fault for o in outcomes if not o.named]
    stuck = [o.fault for o in outcomes if not o.recovered]
    total = len(outcomes)
    figures = [
        figure(f"of {total} runs: fault not named", len(unnamed), most=0),
        figure("runs not recovered, nor ended well", len(stuck), most=0),
        Figure(
            "worst depth peak offered as good", f"{worst:+.3f} %", f"within {within:g} %",
            bool(abs(worst) < within),
        ),
    ]  # fmt: skip
    return Report("Fault tour", figures, [header, *rows], {"runs": [asdict(o) for o in outcomes]})


@benchmark(
    "fault_tour",
    __doc__,
    click.option("--light", type=click.Choice(list(LIGHTS)), default="lcd", help="What else shines."),
    click.option(
        "--rig", "name", type=click.Choice(list(MIDDLES_MM)), default="simulated", help="The bench."
    ),
)
def command(quick: bool, light: str, name: str) -> Report:
    return measure(FAULTS, (True,) if quick else (False, True), light, name)


if __name__ == "__main__":
    start(command)
