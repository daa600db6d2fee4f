"""The press of a study: one dent that comes down at a time, so that its numbers can be varied."""

from __future__ import annotations

from typing import Literal

from zeromethod.rig.tables import NotNegative, Positive, Table
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape
from zeromethod.simulation.press_file import Phase
from zeromethod.simulation.scenario import Scenario

UNTOUCHED_S = 0.1


class PressTable(Table):
    """One press in place of the rig's.

    size_mm: Gaussian and edge sigma, ball radius, cone contact radius. It comes down at `at_s`, within
    `within_s` (0: a jump), and stays; from then on it slides along x and y with `speed_mm_s`. A run is
    "untouched" before, "hold" from when it is down where it stays, else "slide".
    """

    shape: Literal["gaussian", "ball", "cone", "edge"] = "gaussian"
    size_mm: Positive = 5.0
    length_mm: Positive = 25.0
    angle_deg: float = 0.0
    x_mm: float = 42.0
    y_mm: float = 0.0
    depth_mm: float = 0.2
    at_s: Positive = UNTOUCHED_S
    within_s: NotNegative = 0.0
    speed_mm_s: tuple[float, float] = (0.0, 0.0)
    until_s: Positive = 10.0

    def scenario(self) -> Scenario:
        """Press in time, as a simulated camera takes it."""
        edge = self.shape == "edge"
        dent = Dent(
            Shape(self.shape), 0.0, 0.0, 0.0, self.size_mm,
            length_mm=self.length_mm if edge else 0.0, angle_deg=self.angle_deg if edge else 0.0,
        )  # fmt: skip
        down_s = self.at_s + self.within_s
        end_s = max(self.until_s, down_s + 1e-3)
        away = [
            place + speed * (end_s - down_s)
            for place, speed in zip(self._place, self.speed_mm_s, strict=True)
        ]
        points = (
            PathPoint(round(1e9 * self.at_s), *self._place, 0.0),
            PathPoint(round(1e9 * down_s), *self._place, self.depth_mm),
            PathPoint(round(1e9 * end_s), away[0], away[1], self.depth_mm),
        )
        rest = "slide" if any(self.speed_mm_s) else "hold"
        phases = (
            Phase(name="untouched", from_s=0.0, to_s=self.at_s),
            Phase(name=rest, from_s=down_s, to_s=end_s),
        )
        return Scenario("study", (PressPath(dent, points),), end_s, phases)

    @property
    def _place(self) -> tuple[float, float]:
        return self.x_mm, self.y_mm
