"""Whatever may come: random scenarios, and whether what is called good is within three of its own sigma.

One to three presses at once, each a soft one (load, ring, rod) or a hard object in elastic contact
(ball, punch, cone, rod, finger), 1 um to 1 mm deep, black, grey or white; there at once, or let down over
some frames, and some slide. Half of the benches have their prism's rubber bonded to its two lower faces, the
others are half-spaces. Noise of 1 to 4 grey levels; on half of them dust, scratches and bubbles. The packaged
bench with four times larger pixels and a pupil of 1.25 mm, its geometry known.

Counted are the nodes called valid in all frames whose state is nulled (locked, resting): depth less
the true one, over sigma. What cannot be nulled need not be good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.calibration_benches import View
from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import small_rig
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import Frame, estimate, frame_of, node_figures
from zeromethod.cli.numbers import Whole
from zeromethod.devices.opening import open_devices
from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.state import NULLED
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.simulation import loads
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.contact.objects import ALBEDO, Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.load_path import LoadPath
from zeromethod.simulation.loads import Load
from zeromethod.simulation.path import PathPoint
from zeromethod.simulation.scenario import Scenario

COUNT, QUICK = 200, 12
SEED = 61
COME_AT, LAST = 24, 60
"""Frames: untouched before (dirt is learned in 16), and of a run."""
BAR = 0.01
"""Share of nodes beyond 3 sigma from which a scenario is listed."""
DEPTHS_MM = (1e-3, 1.0)
HOW_MANY = (0.5, 0.3, 0.2)
"""Shares of scenarios with one, two and three presses."""
SLIDE_MM_S = 10.0
PUPIL_MM = 1.25
APART_MM = 9.0
"""Least distance of presses at once: hard contacts on each other are no scene."""


@dataclass(frozen=True)
class Case:
    """A scenario, and the rig on which it plays."""

    name: str
    rig: Rig
    scenario: Scenario


@dataclass(frozen=True)
class Outcome:
    """What came of a scenario.

    good: share of frames after the presses that were called nulled. nodes: of every frame that was.
    worst: largest error over sigma. state: the last one.
    """

    number: int
    name: str
    state: str
    good: float
    nodes: list[Frame]
    worst: float
    largest_mm: float

    @property
    def beyond(self) -> float:
        """Share of nodes beyond 3 sigma in frames with a press."""
        pressed = [frame for frame in self.nodes if frame[0]]
        return sum(frame[2] for frame in pressed) / max(sum(frame[1] for frame in pressed), 1)


def _size(draw: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(draw.uniform(np.log(low), np.log(high))))


def _solid(draw: np.random.Generator) -> Solid:
    albedo = list(ALBEDO.values())[int(draw.integers(len(ALBEDO)))]
    angle = float(draw.uniform(0.0, 180.0))
    kind = int(draw.integers(5))
    if kind == 0:
        return Solid(Form.BALL, _size(draw, 5.0, 80.0), albedo=albedo)
    if kind == 1:
        return Solid(Form.PUNCH, _size(draw, 0.6, 4.0), albedo=albedo)
    if kind == 2:
        return Solid(Form.CONE, flank_deg=float(draw.uniform(3.0, 20.0)), albedo=albedo)
    if kind == 3:
        length = float(draw.uniform(4.0, 10.0))
        return Solid(Form.EDGE, _size(draw, 3.0, 20.0), length_mm=length, angle_deg=angle, albedo=albedo)
    return Solid(
        Form.FINGER, _size(draw, 8.0, 15.0), ridge_pitch_mm=0.45, ridge_height_mm=0.03, angle_deg=angle,
        albedo=albedo,
    )  # fmt: skip


def _soft(draw: np.random.Generator) -> Load:
    kind, width_mm = int(draw.integers(3)), _size(draw, 1.4, 10.0)
    if kind == 0:
        return Load(loads.Form.LOAD, width_mm)
    if kind == 1:
        return Load(loads.Form.RING, min(width_mm, 4.0), _size(draw, 1.0, 6.0))
    length_mm, angle_deg = float(draw.uniform(4.0, 12.0)), float(draw.uniform(0.0, 180.0))
    return Load(loads.Form.ROD, min(width_mm, 4.0), length_mm=length_mm, angle_deg=angle_deg)


def _course(
    rig: Rig, draw: np.random.Generator, x_mm: float, y_mm: float, depth_mm: float, *, slides: bool
) -> tuple[PathPoint, ...]:
    """At once, or in four frames; half of those that may slide do so after that."""
    rate = rig.camera.rate_hz
    come = COME_AT + int(draw.integers(8))
    start_ns, down_ns = (round(1e9 * frame / rate) for frame in (come, come + 4 * int(draw.integers(2))))
    points = [PathPoint(start_ns, x_mm, y_mm, 0.0), PathPoint(down_ns, x_mm, y_mm, depth_mm)]
    if slides and draw.uniform() < 0.5:
        away, end_ns = draw.uniform(0, 2 * np.pi), round(1e9 * LAST / rate)
        way = SLIDE_MM_S * 1e-9 * (end_ns - down_ns)
        x_to, y_to = x_mm + float(np.cos(away)) * way, y_mm + float(np.sin(away)) * way
        points.append(PathPoint(end_ns, x_to, y_to, depth_mm))
    return tuple(points)


def case(number: int) -> Case:
    """Scenario of that number, always the same."""
    draw = generator(SEED, number)
    prism = bool(number % 2)
    dirt = {
        "dust": int(draw.integers(1, 20)),
        "scratches": int(draw.integers(3)),
        "bubbles": int(draw.integers(5)),
    }
    dirty = bool(draw.integers(2))
    rig = small_rig().model_copy(update={"scenario": "none"})
    noise = {**rig.camera.noise.model_dump(), "read_grey": _size(draw, 1.0, 4.0)}
    rig = rig.replace(
        {
            "camera.pupil_mm": PUPIL_MM,
            "camera.noise.read_grey": noise["read_grey"],
            "simulation.seed": seed(number),
        }
        | ({f"simulation.nuisances.{key}": value for key, value in dirt.items()} if dirty else {})
        | ({"rubber.support": {"pattern": "bonded", "camera": "bonded", "ends": "free"}} if prism else {})
    )
    view = View(rig)
    places: list[tuple[float, float]] = []
    names: list[str] = []
    pressing: list[LoadPath] = []
    objects: list[ObjectPath] = []
    for one in range(1 + int(draw.choice(3, p=HOW_MANY))):
        for _ in range(100):
            x, y = view.place(float(draw.uniform(0.05, 0.95)), float(draw.uniform(0.05, 0.95)))
            if all(np.hypot(x - px, y - py) > APART_MM for px, py in places):
                break
        places.append((x, y))
        depth_mm = _size(draw, *DEPTHS_MM)
        if draw.uniform() < 0.5:
            soft, course = _soft(draw), _course(rig, draw, x, y, depth_mm, slides=True)
            pressing.append(LoadPath(soft, course))
            names.append(f"{soft.form} {1e3 * depth_mm:.3g} µm")
        else:
            solid = _solid(draw)
            jump = _course(rig, draw, x, y, depth_mm, slides=False)
            # solved once for all: hard objects come at once
            jump = (replace(jump[0], time_ns=jump[-1].time_ns), jump[-1])
            objects.append(ObjectPath(solid, jump, number=one))
            names.append(f"hard {solid.form.value} {1e3 * depth_mm:.3g} µm")
    words = ", ".join(names) + (", dirt" if dirty else "") + (", prism" if prism else "")
    scenario = Scenario("scenario", (), 1e9, (), tuple(objects), rig.rubber, rig.prism, loads=tuple(pressing))
    return Case(words, rig, scenario)


def run(number: int) -> Outcome:
    """Run a scenario, and hold every node that is called good against the truth."""
    one = case(number)
    nodes: list[Frame] = []
    worst = largest_mm = 0.0
    good = frames = 0
    state = "none"
    with open_devices(one.rig) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = one.scenario
        with Session(one.rig, devices=devices) as session:
            for step in session.run(frames=LAST):
                state = step.state.value
                pressed = (step.frame_number or 0) > COME_AT
                frames += pressed
                good += pressed and step.state in NULLED
                surface = step.surface
                if surface is None or step.state not in NULLED:
                    continue
                valid = surface.valid
                true_mm = camera.truth(step.time_ns).depth(surface.x_mm[valid], surface.y_mm[valid])
                error_mm = np.abs(surface.depth_mm[valid] - true_mm)
                ratio = error_mm / surface.sigma_depth_mm[valid]
                if ratio.size:
                    nodes.append(frame_of(error_mm, surface.sigma_depth_mm[valid], pressed=pressed))
                if ratio.size and ratio.max() > worst:
                    worst, largest_mm = float(ratio.max()), float(error_mm[ratio.argmax()])
    return Outcome(number, one.name, state, good / max(frames, 1), nodes, worst, largest_mm)


def summarise(outcomes: Sequence[Outcome], refused: Sequence[str]) -> Report:
    """The bar, and a line for each scenario that has more than the bar's share beyond."""
    over = [one for one in outcomes if one.beyond > BAR]
    nodes, good = [one.nodes for one in outcomes], estimate(np.mean, [one.good for one in outcomes])
    figures = [
        *node_figures(nodes, nodes),
        figure("frames with a press called good", *good, unit="%", least=0.98, of_other=True),
        Figure("scenarios with more than 1 % beyond while pressed", f"{len(over)} of {len(outcomes)}"),
        Figure(
            "scenarios nulled at the end",
            f"{sum(one.state in NULLED for one in outcomes)} of {len(outcomes)}",
        ),
        Figure("drawn but no scene (contacts on each other, without end)", f"{len(refused)}"),
    ]
    details: list[Sequence[str]] = [
        ("number", "scenario", "state", "nulled", "beyond, pressed", "worst, sigmas", "off, µm")
    ]
    details += [
        (
            f"{one.number}", one.name, one.state, f"{one.good:.0%}",
            f"{one.beyond:.1%}",
            f"{one.worst:.1f}", f"{1e3 * one.largest_mm:.2f}",
        )
        for one in sorted(over, key=lambda one: -one.beyond)
    ]  # fmt: skip
    data: dict[str, Any] = {"scenarios": [asdict(one) for one in outcomes], "refused": list(refused)}
    return Report("Random scenarios: what is called good, against its own sigma", figures, details, data)


@benchmark(
    "scenarios",
    __doc__,
    click.option("--scenarios", type=Whole(min=1), default=COUNT, show_default=True, help="How many."),
    click.option("--first", type=Whole(min=0), default=0, show_default=True, help="Number of the first."),
    part_options,
    salt_option,
)
def command(quick: bool, scenarios: int, first: int, keep: Path | None, most_runs: int | None) -> Report:
    """Run what is missing, and judge all."""

    def one(number: int) -> dict[str, Any]:
        try:
            return asdict(run(first + number))
        except (InputError, MeasurementError) as error:
            return {"refused": f"{first + number}: {error}"}

    found = Parts(keep, most_runs, first=first).run(QUICK if quick else scenarios, "scenarios", one)
    refused = [entry["refused"] for entry in found if "refused" in entry]
    return summarise([Outcome(**entry) for entry in found if "refused" not in entry], refused)


if __name__ == "__main__":
    start(command)
