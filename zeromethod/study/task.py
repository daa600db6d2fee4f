"""One run as it goes to a worker: everything in it, so that any process can carry it out, in any order."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from zeromethod.rig.model import Rig
from zeromethod.rig.tables import NotNegative, Positive, Table
from zeromethod.simulation.load_path import LoadPath
from zeromethod.simulation.loads import Form, Load
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape
from zeromethod.simulation.press_file import Phase
from zeromethod.simulation.scenario import Scenario

LIMIT_S = 3600.0
"""How long a run may take unless its study says otherwise."""

Figures = Mapping[str, Any]
"""Numbers, words, true or false, None; by dotted names."""


class StudyPress(Table):
    """One press in place of the rig's.

    size_mm: load width, Gaussian and edge sigma, ball radius, cone contact radius. A load presses the bench's
    rubber; the others are formulas. It comes down at `at_s`, within
    `within_s` (0: a jump), and stays; from then on it slides along x and y with `speed_mm_s`. A run is
    "untouched" before, "hold" from when it is down where it stays, else "slide".
    """

    shape: Literal["load", "gaussian", "ball", "cone", "edge"] = "load"
    size_mm: Positive = 3.54
    length_mm: Positive = 25.0
    angle_deg: float = 0.0
    x_mm: float = 42.0
    y_mm: float = 0.0
    depth_mm: float = 0.2
    at_s: Positive = 0.1
    within_s: NotNegative = 0.0
    speed_mm_s: tuple[float, float] = (0.0, 0.0)
    until_s: Positive = 10.0

    def scenario(self, bench: Rig) -> Scenario:
        """Press in time, for a simulated camera."""
        down_s = self.at_s + self.within_s
        end_s = max(self.until_s, down_s + 1e-3)
        (vx, vy), slide_s = self.speed_mm_s, end_s - down_s
        points = (
            PathPoint(round(1e9 * self.at_s), self.x_mm, self.y_mm, 0.0),
            PathPoint(round(1e9 * down_s), self.x_mm, self.y_mm, self.depth_mm),
            PathPoint(round(1e9 * end_s), self.x_mm + vx * slide_s, self.y_mm + vy * slide_s, self.depth_mm),
        )
        phases = (
            Phase(name="untouched", from_s=0.0, to_s=self.at_s),
            Phase(name="slide" if any(self.speed_mm_s) else "hold", from_s=down_s, to_s=end_s),
        )
        whole = Scenario("study", (), end_s, phases, rubber=bench.rubber, prism=bench.prism)
        if self.shape == "load":
            return replace(whole, loads=(LoadPath(Load(Form.LOAD, self.size_mm), points),))
        edge = self.shape == "edge"
        dent = Dent(
            Shape(self.shape), 0.0, 0.0, 0.0, self.size_mm,
            length_mm=self.length_mm if edge else 0.0, angle_deg=self.angle_deg if edge else 0.0,
        )  # fmt: skip
        return replace(whole, presses=(PressPath(dent, points),))


@dataclass(frozen=True)
class Task:
    """What a run needs.

    rig: what is believed of the bench. bench: what it truly is, where that differs. press: in place of the
    rig's. settings: of the procedure itself. recording: path of the recording to read, where there is one.
    limit_s: time after which it is given up, on the host's clock.
    """

    run: int
    seed: int
    procedure: str
    rig: Rig
    bench: Rig | None = None
    press: StudyPress | None = None
    frames: int | None = None
    seconds: float | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()
    recording: str | None = None
    rig_settings: Mapping[str, Any] = field(default_factory=dict)
    limit_s: float = LIMIT_S

    def as_json(self) -> str:
        """Everything that its figures depend on."""
        values = {name: value for name, value in vars(self).items() if name != "limit_s"}
        return json.dumps(values, sort_keys=True, default=lambda table: table.model_dump(mode="json"))


@dataclass(frozen=True)
class Procedure:
    """What a run does.

    figures: name and meaning, unit included, of every figure that it can give. settings: its own keys with
    their defaults. It may raise MeasurementError or InputError; the run has then failed.
    """

    carry_out: Callable[[Task], Figures]
    figures: Mapping[str, str]
    settings: Mapping[str, Any] = field(default_factory=dict)
    reads_recordings: bool = False
