"""Faults of camera and display while fingers touch or a cloth is rubbed: what is said of them meanwhile.

--rig interactive: two fingers through the cloth, under a white picture, pixels twice as large as the rig's.
They are down when the fault comes, or come down behind its back, and lift half a second after it. Each is
to have a pointerdown whenever it is there to be seen, nothing else may have one, and all that went down ends:
up, or cancel where nobody could know.

--rig rubbing: woven cloth slides at 20 mm/s over the packaged bench, or halts behind the fault's back. No
stick or slip may be named that was not there, the halt has to be, no speed may be off by more than 3 sigma,
and at the end the cloth has to be read again.

Both: besides the faults of `fault_tour` the camera is turned by 0.5 and 2 px, after which no frame may be
called good from the 10th on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks.fault_tour import FAULT_FRAME, FAULTS, Fault
from benchmarks.honesty import FRAMES_TO_NAME, turned_by_a_pixel_deg
from benchmarks.interactive import NEAR_MM, finger
from benchmarks.interactive import bench as interactive_bench
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import changed
from benchmarks.rubbing import rub_rig
from benchmarks.totals import SIGMAS
from zeromethod.interactive.pointers import PointerType
from zeromethod.loop.events import Event
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig
from zeromethod.rubbing import Motion
from zeromethod.session.session import Session

RATE_HZ = 60.0
FAULT_S = (FAULT_FRAME + 0.3) / RATE_HZ
HELD_S, END_S = 0.5, 0.15
"""How long fingers stay after what the fault takes, and until the run ends."""
REOPENED_S = 1.5
"""Within which a camera that is back is opened again and its first frames are read."""
DOWN_S = 0.3
PLACES_MM, RADIUS_MM, FORCE_N = ((34.0, -5.0), (52.0, 6.0)), 30.0, 0.4
SPEED_MM_S = 20.0
SETTLED_S = 0.05
"""After which stick or slip that begins is no longer news."""
SLIP_S, LATEST_HALT = 0.32, 4.2
"""When the cloth begins to slide, and frames after the fault by which it halts: it has to stay in view."""
LAST_FRAMES = 6
TURNS_PX = (0.5, 2.0)
QUICK_EVERY = 5
RIGS = ("interactive", "rubbing")


class Case(NamedTuple):
    """meanwhile: fingers come down, or the cloth halts, behind the fault's back."""

    fault: Fault
    meanwhile: bool


def turned(rig: Rig, px: float) -> Fault:
    """The camera turned by so many pixels at once."""
    keys = {"moved_at_frame": FAULT_FRAME, "camera_turned_deg": (px * turned_by_a_pixel_deg(rig), 0.0, 0.0)}
    return Fault(f"camera turned by {px:g} px", keys, Event.PICTURES_MIXED, recovers=False)


def cases(rig: Rig) -> list[Case]:
    """All of them; cloth that slides on is out of view when a fault of a second is over."""
    faults = [*FAULTS, *(turned(rig, px) for px in TURNS_PX)]
    planned = [Case(one, later) for one in faults for later in (False, True) if one.recovers or not later]
    slides = rig.control.rubbing
    return [one for one in planned if one.meanwhile or not slides or dead_s(one.fault) < HELD_S]


def dead_s(fault: Fault) -> float:
    """How long a fault takes the camera's or the LCD's pictures away."""
    back_s = fault.keys.get("camera_back_after_s")
    dark_s = fault.keys.get("stall_s", 0.0) if back_s is None else back_s + REOPENED_S
    return (fault.changes_after + 1.0) / RATE_HZ + float(dark_s)


def touched(case: Case) -> str:
    """Press file of two fingers."""
    down = FAULT_S + case.fault.changes_after / RATE_HZ if case.meanwhile else DOWN_S
    up, text = FAULT_S + dead_s(case.fault) + HELD_S, ""
    for x, y in PLACES_MM:
        points = ((down, 0.0), (down, FORCE_N), (up, FORCE_N), (up, 0.0))
        text += finger(RADIUS_MM, ((at, x, y, force) for at, force in points))
    return text


def run(name: str, case: Case, folder: Path) -> dict[str, Any]:
    """One run, and what was said in it."""
    end_s = FAULT_S + dead_s(case.fault) + HELD_S + END_S
    if name == "interactive":
        press = folder / "fingers.toml"
        press.write_text(f"duration_s = {end_s}\n{touched(case)}")
        rig = interactive_bench("white").replace({}, scenario=str(press))
    else:
        halt_s = FAULT_S + min(case.fault.changes_after, LATEST_HALT) / RATE_HZ if case.meanwhile else end_s
        rig = rub_rig(folder, SPEED_MM_S, SLIP_S, halt_s, end_s)
    if case.fault.keys:
        rig = changed(rig, simulation={"faults": case.fault.keys})
    with Session(rig) as session:
        steps = list(session.run(seconds=end_s))
    said = fingers_of(steps, case) if name == "interactive" else motions_of(steps, halt_s)
    return {"fault": case.fault.name, "meanwhile": case.meanwhile, **ending(steps, case), **said}


def ending(steps: list[Step], case: Case) -> dict[str, Any]:
    """Whether the fault was named, and the run went on or ended as it should."""
    after = [one for one in steps if one.frame_number is None or one.frame_number >= FAULT_FRAME]
    events = [str(event) for one in after for event in one.events]
    states = list(dict.fromkeys(str(one.state) for one in after))
    bumped = "moved_at_frame" in case.fault.keys
    named = str(case.fault.event) in events or not case.fault.keys
    if bumped:
        late = [one for one in after if one.number > FAULT_FRAME + FRAMES_TO_NAME]
        named = not any(one.state in NULLED for one in late)
        ended = steps[-1].state not in NULLED
    elif case.fault.recovers:
        # under what slides the mirror is never still: there it is well when it is read again
        read = [one.contact_status for one in steps[-LAST_FRAMES:] if one.contact_status is not None]
        ended = steps[-1].state in NULLED or any(np.isfinite(one.share) for one in read)
    else:
        ended = steps[-1].state is State.FAULT
    return {"named": named, "ended": ended, "states": states, "reason": steps[-1].reason}


def fingers_of(steps: list[Step], case: Case) -> dict[str, Any]:
    """Downs that are no finger's, fingers without one, and what went down and never ended."""
    events = [event for step in steps for event in step.pointers]
    downs = [event for event in events if event.type is PointerType.DOWN]
    near = [[np.hypot(one.x_mm - x, one.y_mm - y) < NEAR_MM for x, y in PLACES_MM] for one in downs]
    lost = 0
    if case.fault.recovers or not case.meanwhile:
        lost = sum(not any(one[k] for one in near) for k in range(len(PLACES_MM)))
    ended = [event.pointer_id for event in events if event.type in (PointerType.UP, PointerType.CANCEL)]
    cancelled = sum(event.type is PointerType.CANCEL for event in events)
    return {
        "invented": sum(not any(one) for one in near) + max(len(ended) - len(downs), 0),
        "lost": lost,
        "open": max(len(downs) - len(ended), 0),
        "words": f"{len(downs)} down, {len(ended) - cancelled} up, {cancelled} cancelled",
    }


def motions_of(steps: list[Step], halt_s: float) -> dict[str, Any]:
    """Stick or slip that was not there; a halt that nobody named; speeds and their errors."""
    found = [(1e-9 * one.time_ns, one.contact_status) for one in steps if one.contact_status is not None]
    sticks = [at for at, one in found if one.event == "stick"]
    slips = [at for at, one in found if one.event == "slip"]
    invented = sum(at < halt_s for at in sticks) + max(len(slips) - 1, 0) + sum(at > halt_s for at in slips)
    still = [one for at, one in found if at > halt_s + SETTLED_S]
    lost = int(bool(still) and still[-1].motion is not Motion.STICK)
    off = [
        abs(one.speed_mm_s - SPEED_MM_S) / one.sigma_speed_mm_s
        for at, one in found
        if one.motion is Motion.SLIP and np.isfinite(one.speed_mm_s) and not one.aliased and at < halt_s
    ]
    beyond = sum(each > SIGMAS for each in off)
    words = f"{len(sticks)} stick, {len(slips)} slip, {len(off)} speeds, {beyond} beyond 3 sigma"
    return {"invented": invented, "lost": lost, "open": beyond, "words": words}


def report(name: str, parts: Parts, every: int = 1) -> Report:
    """Run all cases of a rig, or every so many of them."""
    with parts.folder() as folder:
        rig = (
            interactive_bench("white")
            if name == "interactive"
            else rub_rig(folder, SPEED_MM_S, SLIP_S, 1.0, 1.0)
        )
        planned = cases(rig)[::every]
        outcomes = parts.run(len(planned), "faults", lambda k: run(name, planned[k], folder))
    count = len(outcomes)
    wrong = {key: sum(one[key] for one in outcomes) for key in ("invented", "lost", "open")}
    named, ended = (sum(one[key] for one in outcomes) for key in ("named", "ended"))
    third = "pointers never ended" if name == "interactive" else "speeds beyond 3 sigma"
    figures = [
        Figure("faults named", f"{named} of {count}", "all", named == count),
        Figure("runs that recovered or ended well", f"{ended} of {count}", "all", ended == count),
        Figure("events that were not there", str(wrong["invented"]), "0", wrong["invented"] == 0),
        Figure("fingers or halts that were not named", str(wrong["lost"]), "0", wrong["lost"] == 0),
        Figure(third, str(wrong["open"]), "0", wrong["open"] == 0),
    ]
    rows: list[list[str]] = [["fault", "meanwhile", "named", "ends", "said", "states from it on"]]
    for one in outcomes:
        yes = {True: "yes", False: "NO"}
        wrongs = "".join(f", {one[key]} {key.upper()}" for key in ("invented", "lost", "open") if one[key])
        ends = "well" if one["ended"] else f"BADLY: {one['reason']}"
        rows.append(
            [
                one["fault"],
                yes[one["meanwhile"]],
                yes[one["named"]],
                ends,
                one["words"] + wrongs,
                " > ".join(one["states"]),
            ]
        )
    return Report(
        f"Faults while {'fingers touch' if name == 'interactive' else 'a cloth is rubbed'}",
        figures,
        rows,
        {"runs": outcomes},
    )


@benchmark(
    "touch_faults",
    __doc__,
    part_options,
    click.option(
        "--rig", "name", type=click.Choice(RIGS), default="interactive", show_default=True, help="Which."
    ),
)
def command(*, quick: bool, name: str, keep: Path | None, most_runs: int | None) -> Report:
    """Run one rig's."""
    return report(name, Parts(keep, most_runs, rig=name, quick=quick), every=QUICK_EVERY if quick else 1)


if __name__ == "__main__":
    start(command)
