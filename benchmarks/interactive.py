"""Interactive surface: fingers through a cloth under a projector's light, and what that light costs.

On the rig `interactive` with twice as large pixels (camera and LCD), its weave as many pixels wide.

Touches: five fingers of random place, size and force come one frame after the other, stay together, and lift;
again and again, elsewhere, under a white picture on which they draw. Each touch is to make one pointerdown
and one pointerup, each within three frames, and nothing else is to. Places and forces are those while all
five are down.

Quiet: nothing touches. Depth is noise, under no picture, a white one, and a film of random blocks.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import coarser
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import estimate, rms
from zeromethod.cli.numbers import Whole
from zeromethod.devices.opening import open_devices
from zeromethod.interactive.pointers import PointerEvent, PointerType
from zeromethod.loop.step import Step
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session

LARGER = 2
FINGERS, GROUPS = 5, 5
"""Fingers at once, and how often they come in one run."""
FRAME_S = 1 / 60
FIRST_S, EVERY_S, HELD_S = 0.3, 18 * FRAME_S, 11 * FRAME_S
X_MM, Y_MM, MOVED_MM, APART_MM = (20.0, 62.0), (-10.0, 10.0), 3.0, 13.0
FORCES_N, RADII_MM = (0.1, 0.8), (20.0, 40.0)
NEAR_MM, SETTLED_FRAMES = 2.0, 3
PICTURES = ("black", "white", "film")
QUIET_FRAMES, WARM_FRAMES = 48, 24
BLOCK_PX = 16


def bench(picture: str) -> Rig:
    """The rig, coarser."""
    rig = coarser(load_rig("interactive"), LARGER)
    assert rig.cloth is not None
    return rig.replace(
        {
            "cloth.weave_mm": LARGER * rig.cloth.weave_mm,
            "projector.picture": picture,
            "simulation.seed": seed(0),
        }
    )


def places(draw: np.random.Generator) -> np.ndarray[Any, Any]:
    """(FINGERS, 2) places, mm, apart from each other."""
    found: list[np.ndarray[Any, Any]] = []
    while len(found) < FINGERS:
        new = draw.uniform([X_MM[0], Y_MM[0]], [X_MM[1], Y_MM[1]])
        if all(np.hypot(*(new - one)) > APART_MM for one in found):
            found.append(new)
        elif draw.random() < 0.02:
            found.clear()
    return np.array(found)


def finger(radius_mm: float, points: Iterable[tuple[float, float, float, float]]) -> str:
    """An object of a press file: a ball at points (time s, x mm, y mm, force N)."""
    path = ", ".join(f"{{time_s = {t}, x_mm = {x}, y_mm = {y}, force_n = {f}}}" for t, x, y, f in points)
    return f'[[object]]\nshape = "ball"\nradius_mm = {radius_mm}\npath = [{path}]\n'


def touches(number: int) -> list[dict[str, Any]]:
    """The touches of run `number`, and what was read of them."""
    draw = generator(number, 22)
    layout, forces, radii = places(draw), draw.uniform(*FORCES_N, FINGERS), draw.uniform(*RADII_MM, FINGERS)
    planned, text = [], f"duration_s = {FIRST_S + GROUPS * EVERY_S + 0.1}\n"
    moved = draw.uniform(-MOVED_MM, MOVED_MM, (GROUPS, 2))
    for k in range(FINGERS):
        points = []
        for group in range(GROUPS):
            x, y = (layout[k] + moved[group]).tolist()
            down = FIRST_S + group * EVERY_S + (k + draw.random()) * FRAME_S
            up = FIRST_S + group * EVERY_S + HELD_S + draw.random() * FRAME_S
            points += [(down, x, y, 0.0), (down, x, y, forces[k]), (up, x, y, forces[k]), (up, x, y, 0.0)]
            planned.append({"group": group, "x": x, "y": y, "force": forces[k], "down": down, "up": up})
        text += finger(radii[k], points)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fingers.toml"
        file.write_text(text)
        with Session(bench("white").replace({}, scenario=str(file))) as session:
            return scored(list(session.run()), planned)


def scored(steps: list[Step], planned: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each touch with its events and errors; one more entry for events that belong to none."""
    events = [event for step in steps for event in step.pointers]
    times = np.array([step.time_ns for step in steps]) * 1e-9
    found, taken = [], 0
    for touch in planned:
        downs = _near(events, touch)
        ids = {one.pointer_id for one in downs}
        ups = [one for one in events if one.type is PointerType.UP and one.pointer_id in ids]
        taken += len(downs) + len(ups)
        late = {
            name: int(np.count_nonzero((times > touch[name]) & (times <= 1e-9 * one.time_ns)))
            for name, all_of in (("down", downs), ("up", ups))
            for one in all_of
        }
        together = max(one["down"] for one in planned if one["group"] == touch["group"])
        errors = [
            ((one.x_mm - touch["x"]), (one.y_mm - touch["y"]), one.sigma_x_mm, one.sigma_y_mm,
             one.force_n / touch["force"] - 1, one.sigma_force_n / touch["force"])
            for step in steps
            if together + SETTLED_FRAMES * FRAME_S < 1e-9 * step.time_ns < touch["up"] - FRAME_S
            for one in step.contacts
            if one.id in ids
        ]  # fmt: skip
        found.append(
            {"downs": len(downs), "ups": len(ups), "late": late, "errors": errors, "force": touch["force"]}
        )
    others = sum(one.type in (PointerType.DOWN, PointerType.UP, PointerType.CANCEL) for one in events) - taken
    return [*found, {"invented": others}]


def _near(events: list[PointerEvent], touch: dict[str, Any]) -> list[PointerEvent]:
    """The events pointerdown that are a touch's."""
    return [
        one
        for one in events
        if one.type is PointerType.DOWN
        and touch["down"] < 1e-9 * one.time_ns < touch["up"] + 2 * FRAME_S
        and np.hypot(one.x_mm - touch["x"], one.y_mm - touch["y"]) < NEAR_MM
    ]


def quiet(picture: str) -> dict[str, Any]:
    """Depth of frames in which nothing touches, nm: rms, and what sigma says."""
    rig = bench("black" if picture == "film" else picture).replace({}, scenario="none")
    draw = generator(22)
    depths, sigmas = [], []
    with open_devices(rig) as devices, Session(rig, devices=devices) as session:
        for step in session.run(frames=QUIET_FRAMES):
            projector, spec = vars(devices.display)["projector"], rig.projector
            if picture == "film" and spec is not None:
                blocks = draw.integers(0, 256, (spec.rows // BLOCK_PX, spec.columns // BLOCK_PX), np.uint8)
                projector.show(np.kron(blocks, np.ones((BLOCK_PX, BLOCK_PX), np.uint8)))
            if step.surface is not None and step.number > WARM_FRAMES:
                depths.append(step.surface.depth_mm[step.surface.valid])
                sigmas.append(step.surface.sigma_depth_mm[step.surface.valid])
    depth, sigma = np.concatenate(depths), np.concatenate(sigmas)
    rms = 1e6 * float(np.sqrt(np.mean(depth**2)))
    return {
        "picture": picture,
        "rms_nm": rms,
        "sigma_nm": 1e6 * float(np.median(sigma)),
        "beyond": float(np.mean(np.abs(depth) > 3 * sigma)),
    }


def report(runs: int, parts: Parts) -> Report:
    """Measure, and hold figures against their bars."""

    def one(number: int) -> Any:
        return quiet(PICTURES[number]) if number < len(PICTURES) else touches(number)

    kept = parts.run(len(PICTURES) + runs, "runs of five fingers", one)
    noise = {each["picture"]: each for each in kept if isinstance(each, dict)}
    all_of = [each for run in kept if isinstance(run, list) for each in run]
    fingers = [each for each in all_of if "downs" in each]
    figures: list[Figure] = []
    if fingers:
        lost = sum(each["downs"] != 1 or each["ups"] != 1 for each in fingers)
        invented = sum(each.get("invented", 0) for each in all_of)
        late = max(max(each["late"].values(), default=0) for each in fingers)
        errors = np.array([error for each in fingers for error in each["errors"]])
        off = np.abs(errors[:, 4])
        # of each finger on its own, as its frames share their error
        each = [np.array(one["errors"]) for one in fingers if one["errors"]]
        place = estimate(rms, [rms(np.hypot(one[:, 0], one[:, 1])) for one in each])
        force = estimate(
            lambda far: np.percentile(far, 95), [np.percentile(np.abs(one[:, 4]), 95) for one in each]
        )
        beyond_place = float(np.mean(np.abs(errors[:, :2]) > 3 * errors[:, 2:4]))
        beyond_force = float(np.mean(off > 3 * errors[:, 5]))
        count = len(fingers)
        figures += [
            figure(f"of {count} touches: without just one down and one up", lost, most=0),
            figure("events invented", invented, most=0),
            figure("latest event", late, unit="frames", most=4),
            figure("error of place, rms", *place, unit="mm", most=0.3),
            figure("error of force, 95 % of touches within", *force, unit="%", most=0.1),
            Figure("force, worst", f"{100 * off.max():.1f} %"),
            Figure("place beyond 3 sigma", f"{100 * beyond_place:.2f} %", "1 %", beyond_place <= 0.01),
            Figure("force beyond 3 sigma", f"{100 * beyond_force:.2f} %", "1 %", beyond_force <= 0.01),
        ]
    dark = noise.get("black")
    for name in PICTURES:
        if name in noise and dark:
            ratio = noise[name]["rms_nm"] / dark["rms_nm"]
            own = noise[name]
            words = f"{own['rms_nm']:.1f} nm, x {ratio:.2f}; beyond 3 sigma {100 * own['beyond']:.2f} %"
            figures.append(Figure(f"depth at rest, {name} picture", words, "x 2", ratio <= 2))
    return Report("Interactive surface", figures, [], {"runs": kept})


@benchmark(
    "interactive",
    __doc__,
    part_options,
    salt_option,
    click.option("--touches", "count", type=Whole(min=0), default=1000, show_default=True, help="Touches."),
)
def command(quick: bool, count: int, keep: Path | None, most_runs: int | None) -> Report:
    count = min(count, FINGERS * GROUPS) if quick else count
    runs = -(-count // (FINGERS * GROUPS))
    return report(runs, Parts(keep, most_runs, runs=runs))


if __name__ == "__main__":
    start(command)
