"""Path of one press: straight lines between points in time, at rest before the first and after the last."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

from zeromethod.simulation.press import Dent, Shape, contact_radius_mm


@dataclass(frozen=True, slots=True)
class PathPoint:
    """Where a press is at `time_ns`: place and depth in mm."""

    time_ns: int
    x_mm: float
    y_mm: float
    depth_mm: float

    @property
    def place(self) -> tuple[float, float, float]:
        """(x, y, depth) mm."""
        return self.x_mm, self.y_mm, self.depth_mm


class Press(Protocol):
    """What moves the mirror: a dent that changes in time."""

    def dent_at(self, time_ns: int) -> Dent | None:
        """Return the dent at `time_ns`; None while there is none."""

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether the dent changes continuously anywhere inside (from, to); jumps do not count."""

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times inside (from, to) at which it jumps or changes its velocity, rising."""


@dataclass(frozen=True)
class PressPath:
    """A dent that follows a path.

    dent: everything but place and depth. points: times must not fall; two points at one time are a jump,
    and that time itself shows the later one. touches: a ball or cone couples light out over its own
    contact area, whatever `dent.contact_mm` says.
    """

    dent: Dent
    points: tuple[PathPoint, ...]
    touches: bool = False

    def dent_at(self, time_ns: int) -> Dent | None:
        """Return the dent at `time_ns`; None while its depth is 0."""
        x_mm, y_mm, depth_mm = place_at(self.points, time_ns)
        if depth_mm == 0:
            return None
        contact_mm = self.dent.contact_mm
        if self.touches and self.dent.shape in {Shape.BALL, Shape.CONE}:
            contact_mm = contact_radius_mm(self.dent.shape, depth_mm, self.dent.size_mm)
        return replace(self.dent, x_mm=x_mm, y_mm=y_mm, depth_mm=depth_mm, contact_mm=contact_mm)

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether the dent changes continuously anywhere inside (from, to); jumps do not count."""
        return moves(self.points, from_ns, to_ns)

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times of the points inside (from, to)."""
        return tuple(point.time_ns for point in self.points if from_ns < point.time_ns < to_ns)


def place_at(points: Sequence[PathPoint], time_ns: int) -> tuple[float, float, float]:
    """(x, y, depth) mm on the path at a time."""
    after = bisect_right(points, time_ns, key=lambda point: point.time_ns)
    if after == 0:
        return points[0].place
    before = points[after - 1]
    if after == len(points):
        return before.place
    behind = points[after]
    if before.place == behind.place:
        return before.place
    share = (time_ns - before.time_ns) / (behind.time_ns - before.time_ns)
    x_mm, y_mm, depth_mm = (a + share * (b - a) for a, b in zip(before.place, behind.place, strict=True))
    return x_mm, y_mm, depth_mm


def moves(points: Sequence[PathPoint], from_ns: int, to_ns: int) -> bool:
    """Whether the path goes on continuously, pressed, anywhere inside (from, to); jumps do not count."""
    for a, b in pairwise(points):
        overlaps = a.time_ns < to_ns and b.time_ns > from_ns and b.time_ns > a.time_ns
        if overlaps and a.place != b.place and (a.depth_mm != 0 or b.depth_mm != 0):
            return True
    return False
