"""A press given by maps of depth at given times, linear in between: a recorded surface."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zeromethod.arrays import Float
from zeromethod.simulation.press import Dent, Shape

STILL_MM = 1e-4
"""Motion within an exposure, anywhere, up to which the mirror counts as still: the camera then sees it where
it is in the middle of the exposure, which is the mean of a straight line."""

BEND_MM = 2e-3
"""Change of the way from one map to the next, anywhere, from which an exposure is cut there."""

Maps = Callable[[int], Float]
"""Coefficients (rows, cols), mm, of the map of that number."""

_KEPT_MAPS = 6
_KEPT_INSTANTS = 4


@dataclass(frozen=True)
class MapPlacement:
    """Where a map lies: middle (x, y) in mm, pitch in mm; rows along y, columns along x."""

    centre_mm: tuple[float, float]
    pitch_mm: float


class MovingMap:
    """A press whose depth is a map of B-spline coefficients at every given time, linear in between.

    Before the first time and after the last it stands still. Maps are asked for when they are needed, and the
    newest few are kept.
    """

    def __init__(self, lattice: MapPlacement, times_ns: Sequence[int], coefficients: Maps) -> None:
        """times_ns: rising. coefficients: of map number index, (rows, cols) in mm, always of one shape."""
        self._lattice = lattice
        self._times_ns = list(times_ns)
        self._map = lru_cache(_KEPT_MAPS)(coefficients)
        self._dent = lru_cache(_KEPT_INSTANTS)(self._new_dent)

    def dent_at(self, time_ns: int) -> Dent | None:
        """Return the dent at `time_ns`, the same object for the newest few instants; None without maps."""
        if not self._times_ns:
            return None
        return self._dent(min(max(time_ns, self._times_ns[0]), self._times_ns[-1]))

    def _new_dent(self, time_ns: int) -> Dent:
        depth = self._depth_at(time_ns)
        place = *self._lattice.centre_mm, 1.0, self._lattice.pitch_mm
        return Dent(Shape.MAP, *place, map=depth, map_coefficients=depth)

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether the mirror changes by more than `STILL_MM` inside (from, to)."""
        if len(self._times_ns) < 2 or to_ns <= self._times_ns[0] or from_ns >= self._times_ns[-1]:
            return False
        change = self._depth_at(to_ns) - self._depth_at(from_ns)
        return bool(np.abs(change).max() > STILL_MM)

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times inside (from, to) at which the velocity jumps."""
        first = bisect_right(self._times_ns, from_ns)
        last = bisect_left(self._times_ns, to_ns)
        return tuple(self._times_ns[index] for index in range(first, last) if self._bends(index))

    def _bends(self, index: int) -> bool:
        """Whether the way after map `index` differs from that before, per time of the longer of both."""
        times, end = self._times_ns, len(self._times_ns) - 1
        steps_ns = [times[k + 1] - times[k] for k in (index - 1, index) if 0 <= k < end]
        here, length = self._map(index), max(steps_ns)
        before = here - self._map(index - 1) if index else np.zeros(1)
        after = self._map(index + 1) - here if index < end else np.zeros(1)
        if index and index < end:
            before, after = before * (length / steps_ns[0]), after * (length / steps_ns[1])
        return bool(np.abs(after - before).max() > BEND_MM)

    def _depth_at(self, time_ns: int) -> Float:
        times = self._times_ns
        index = bisect_right(times, time_ns) - 1
        if index < 0:
            return self._map(0)
        before = self._map(index)
        if index == len(times) - 1 or times[index] == time_ns:
            return before
        after = self._map(index + 1)
        share = (time_ns - times[index]) / (times[index + 1] - times[index])
        return before if after is before else before + share * (after - before)
