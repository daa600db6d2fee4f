"""The truth of the frames, one JSON line each, to compare a rehearsal with."""

from __future__ import annotations

import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Dent, Mirror, Shape

FORMAT = "zeromethod-truth-1"
CLOCK = "monotonic"
"""The host's CLOCK_MONOTONIC in ns, `time.monotonic_ns()`: the same in all processes of one machine."""


class Deepest(NamedTuple):
    """The deepest point of the rubber (or, under negative dents only, the highest): mm."""

    depth_mm: float
    x_mm: float
    y_mm: float


def deepest(mirror: Mirror) -> Deepest | None:
    """Largest |depth| of the whole mirror, to 1e-6 of itself and 1 µm; None at rest."""
    best: Deepest | None = None
    for dent in mirror.dents:
        found = Deepest(0.0, dent.x_mm, dent.y_mm)
        half_mm = _reach_mm(dent)
        while half_mm > 1e-4:
            step = np.linspace(-half_mm, half_mm, 41)
            x, y = np.meshgrid(found.x_mm + step, found.y_mm + step)
            depth = mirror.depth(x, y)
            at = np.unravel_index(np.argmax(np.abs(depth)), depth.shape)
            found = Deepest(float(depth[at]), float(x[at]), float(y[at]))
            half_mm /= 10
        if best is None or abs(found.depth_mm) > abs(best.depth_mm):
            best = found
    return best


def _reach_mm(dent: Dent) -> float:
    """Largest distance of a dent's deepest point from its centre, mm."""
    if dent.shape is Shape.MAP and dent.map is not None:
        return dent.size_mm * float(np.hypot(*dent.map.shape)) / 2
    return dent.length_mm / 2 + (dent.size_mm if dent.shape is not Shape.BALL else 1.0)


class TruthFile:
    """Writes the header, then a line per frame, each flushed; a context manager."""

    def __init__(self, path: Path, rig: Rig, press: str) -> None:
        """Begin a new file; raises OSError where it cannot be written."""
        self._file = path.open("w", encoding="utf-8")
        self._known: tuple[Mirror, Deepest | None] = Mirror(), None
        header = {
            "format": FORMAT,
            "rig": rig.name,
            "press": press,
            "version": version("zeromethod"),
            "clock": CLOCK,
            "opened_ns": time.monotonic_ns(),
        }
        self._write(header)

    def frame(
        self, number: int, time_ns: int, scenario_s: float | None, phase: str | None, mirror: Mirror
    ) -> None:
        """Write the mirror of frame `number` at its mid-exposure `time_ns`; scenario_s None: not begun."""
        if mirror != self._known[0]:
            self._known = mirror, deepest(mirror)
        peak = self._known[1]
        dents = [
            {"shape": str(d.shape), "x_mm": d.x_mm, "y_mm": d.y_mm, "depth_mm": d.depth_mm}
            for d in mirror.dents
        ]
        self._write(
            {
                "number": number,
                "time_ns": time_ns,
                "scenario_s": scenario_s,
                "phase": phase,
                "presses": dents,
                "peak_depth_mm": peak.depth_mm if peak else 0.0,
                "peak_x_mm": peak.x_mm if peak else None,
                "peak_y_mm": peak.y_mm if peak else None,
            }
        )

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
