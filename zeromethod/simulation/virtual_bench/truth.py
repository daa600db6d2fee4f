"""The truth of the frames, one JSON line each, to compare a rehearsal with."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape

FORMAT = "zeromethod-truth-1"
CLOCK = "monotonic"
"""The host's CLOCK_MONOTONIC in ns, `time.monotonic_ns()`: the same in all processes of one machine."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A time of the scenario: seconds from its start (None: not begun), its phase, the mirror."""

    scenario_s: float | None
    phase: str | None
    mirror: Mirror


class Deepest(NamedTuple):
    """The deepest point of the rubber (or, under negative dents only, the highest): mm."""

    depth_mm: float
    x_mm: float | None
    y_mm: float | None


def deepest(mirror: Mirror) -> Deepest:
    """Largest |depth| of the whole mirror, to 1e-6 of itself and 1 µm; nowhere at rest."""
    best = Deepest(0.0, None, None)
    for dent in mirror.dents:
        depth_mm, (x_mm, y_mm, half_mm) = 0.0, _around(dent)
        while half_mm > 1e-4:
            step = np.linspace(-half_mm, half_mm, 41)
            x, y = np.meshgrid(x_mm + step, y_mm + step)
            depth = mirror.depth(x, y)
            at = np.unravel_index(np.argmax(np.abs(depth)), depth.shape)
            depth_mm, x_mm, y_mm = float(depth[at]), float(x[at]), float(y[at])
            half_mm /= 10
        if best.x_mm is None or abs(depth_mm) > abs(best.depth_mm):
            best = Deepest(depth_mm, x_mm, y_mm)
    return best


def _around(dent: Dent) -> tuple[float, float, float]:
    """(x, y, half) mm of a square that a dent's deepest point lies in."""
    if dent.shape is Shape.WHOLE_PLANE and dent.map is not None:
        # in its middle the map is even in w = x / size
        row, col = np.unravel_index(np.argmax(dent.map), dent.map.shape)
        rows, cols = dent.map.shape
        w = np.array([2 * col / (cols - 1) - 1, 2 * row / (rows - 1) - 1])
        along, across = dent.size_mm * w / np.sqrt(1 - w**2)
        x_mm, y_mm = dent.world(along, across)
        return float(x_mm), float(y_mm), 10 * dent.size_mm / cols
    half_mm = dent.length_mm / 2 + (dent.size_mm if dent.shape is not Shape.BALL else 1.0)
    if dent.shape is Shape.MAP and dent.map is not None:
        half_mm = dent.size_mm * float(np.hypot(*dent.map.shape)) / 2
    return dent.x_mm, dent.y_mm, half_mm


class TruthFile:
    """Writes the header, then a line per frame, each flushed; a context manager."""

    def __init__(self, path: Path, rig: Rig, press: str) -> None:
        """Begin a new file; raises OSError where it cannot be written."""
        self._file = path.open("w", encoding="utf-8")
        self._known = Mirror(), deepest(Mirror())
        header = {
            "format": FORMAT,
            "rig": rig.name,
            "press": press,
            "version": version("zeromethod"),
            "clock": CLOCK,
            "opened_ns": time.monotonic_ns(),
        }
        self._write(header)

    def frame(self, number: int, time_ns: int, moment: Moment) -> None:
        """Write the mirror of frame `number`, that of its mid-exposure `time_ns`."""
        if moment.mirror != self._known[0]:
            self._known = moment.mirror, deepest(moment.mirror)
        peak = self._known[1]
        keys = ("shape", "x_mm", "y_mm", "depth_mm")
        times = {"number": number, "time_ns": time_ns, "scenario_s": moment.scenario_s, "phase": moment.phase}
        presses = [{key: getattr(dent, key) for key in keys} for dent in moment.mirror.dents]
        place = {f"peak_{key}": value for key, value in peak._asdict().items()}
        self._write(times | {"presses": presses} | place)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, values: dict[str, Any]) -> None:
        self._file.write(json.dumps(values) + "\n")
        self._file.flush()

    def __enter__(self) -> TruthFile:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
