"""A hard object that is moved: along a path of places and of depths or forces."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.simulation.contact.objects import Held, Solid
from zeromethod.simulation.path import PathPoint, moves, place_at


@dataclass(frozen=True)
class ObjectPath:
    """An object that follows a path; it is lifted where its depth or force is not above 0.

    points: times must not fall; two at one time are a jump. by_force: their depths are forces, N.
    number: of the object in its scenario.
    """

    solid: Solid
    points: tuple[PathPoint, ...]
    by_force: bool = False
    number: int = 0

    def held_at(self, time_ns: int) -> Held | None:
        """The object at `time_ns`; None while it is lifted. A force below 0 pulls at a ball that sticks."""
        x_mm, y_mm, load = place_at(self.points, time_ns)
        pulls = load < 0 and self.by_force and self.solid.adhesion_j_m2 > 0
        if load <= 0 and not pulls:
            return None
        depth_mm, force_n = (None, load) if self.by_force else (load, None)
        return Held(self.solid, x_mm, y_mm, depth_mm, force_n, self.number)

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether it moves continuously anywhere inside (from, to); jumps do not count."""
        return moves(self.points, from_ns, to_ns)

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times inside (from, to) at which it jumps or changes its velocity, rising."""
        return tuple(point.time_ns for point in self.points if from_ns < point.time_ns < to_ns)
