"""A small simulated bench that stands otherwise than its rig file says, pressed when it is asked for."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path

import numpy as np
from crooked_bench import crooked
from small_rigs import small_rig_file

from zeromethod import Calibration, Devices, Rig, Warp, binned, load_rig
from zeromethod.calibration import KnownPress, Presses, RestReading
from zeromethod.clock import Clock
from zeromethod.optics import Dented, Optics
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.loads import load
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.scenario import Scenario
from zeromethod.warp.validity import Flag

LATENCY_S = 0.02
LEAD_S, MOVE_S, HOLD_S = 0.1, 0.05, 0.6
"""From being asked to the press, its way down and up, and how long it is held."""

PAD_MM = 3.5
"""Width of the pad's pressure."""


def nominal(coarser: int = 4) -> Rig:
    """What the rig file says: 160 x 128 camera px, nodes 4 px apart, and an LCD so many times coarser."""
    rig = load_rig("simulated")
    columns, rows = rig.display.columns // coarser, rig.display.rows // coarser
    size = {"columns": columns, "rows": rows, "pitch_mm": coarser * rig.display.pitch_mm}
    lcd = rig.display.model_copy(update=size)
    target = rig.target.model_copy(update={"period_px": 8})
    return binned(rig, 8).model_copy(update={"display": lcd, "scenario": "none", "target": target})


def quarter() -> Rig:
    """The same bench by a quarter of the camera's pixels: for what does not depend on noise."""
    return binned(nominal(), 2)


def rig_file(rig: Rig, path: Path, **values: object) -> Path:
    """The packaged rig file, comments and all, with the pixels of `rig`, and other values by key."""
    keys = ("display.columns", "display.rows", "display.pitch_mm", "camera.columns", "camera.rows")
    keys += ("camera.focal_px", "camera.centre_px", "target.period_px")
    return small_rig_file(path, {key: attrgetter(key)(rig) for key in keys} | {"scenario": "none"} | values)


def truth(given: Rig) -> Rig:
    """The bench as it is."""
    rig = crooked(given)
    return rig.model_copy(update={"display": rig.display.model_copy(update={"latency_s": LATENCY_S})})


class PlantedDisplay(SimulatedDisplay):
    """Display of the true bench by a quarter of the pixels, whatever the rig file says."""

    name = "Planted 5.5"

    def __init__(self, rig: Rig, clock: Clock) -> None:
        super().__init__(truth(quarter()), clock)


class PlantedCamera(SimulatedCamera):
    """Camera of the true bench by a quarter of the pixels, whatever the rig file says."""

    serial = "0042"

    def __init__(self, rig: Rig, clock: Clock, display: object) -> None:
        super().__init__(truth(quarter()), clock, display)


@dataclass
class Hand:
    """Listens to a calibration, and presses when it is asked to. lines, counts: what it heard.

    ball_mm: radius of the ball that it presses with, instead of a soft pad.
    """

    devices: Devices
    depths_mm: Sequence[float] = ()
    places_mm: Sequence[tuple[float, float]] = ()
    ball_mm: float | None = None
    lines: list[str] = field(default_factory=list)
    counts: dict[str, tuple[int, int]] = field(default_factory=dict)

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:
        self.counts[words] = 0, total

        def advance() -> None:
            self.counts[words] = self.counts[words][0] + 1, total

        return nullcontext(advance)

    def say(self, words: str) -> None:
        self.lines.append(words)
        if words.startswith("press") and "now" in words:
            self.press(int(words.split()[1]) - 1)

    def press(self, number: int) -> None:
        camera = getattr(self.devices.camera, "device", self.devices.camera)
        assert isinstance(camera, SimulatedCamera)
        depth, (x, y) = self.depths_mm[number], self.places_mm[number]
        lifted_s = LEAD_S + MOVE_S + HOLD_S
        path = ((LEAD_S, 0.0), (LEAD_S + MOVE_S, depth), (lifted_s, depth), (lifted_s + MOVE_S, 0.0))
        now_ns = self.devices.clock.now_ns()
        points = tuple(PathPoint(now_ns + round(1e9 * t), x, y, d) for t, d in path)
        pad, ball_mm = load(x, y, depth, PAD_MM), self.ball_mm
        dent = pad if ball_mm is None else Dent(Shape.BALL, x, y, depth, ball_mm)
        camera.scenario = Scenario("asked for", (PressPath(dent, points),), 1e9)


def read_elsewhere(calibration: Calibration, given: Rig, x_mm: float) -> tuple[float, float]:
    """A press of another place, depth and width: depth as read through the calibration, and the true one, mm.

    Its warp is by exact rays through the true bench.
    """
    rig, grid, depth_mm = truth(given), calibration.grid, 0.1
    optics = Optics(rig)
    flags = np.full(grid.shape, int(Flag.OUTSIDE), np.uint16)
    flags[grid.inner] = 0

    def warp(mirror: Mirror) -> Warp:
        q = optics.trace(*grid.mesh(), Dented(optics.rest, mirror)).q
        return Warp(q, np.full(q.shape, 0.02), flags, 0)

    other = KnownPress("other", warp(Mirror((load(x_mm, -2.0, depth_mm, 2.8),))), 0.1, 0.1)
    presses = Presses.of(RestReading.of(grid, warp(Mirror())), [other])
    (peak,) = presses.prepared(calibration.rig).peaks(calibration.rig)
    return peak.depth_mm, depth_mm
