"""Approaches before the simulated watch camera of the packaged rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from zeromethod.approach import Approach, WatchReader
from zeromethod.clock import SimulatedClock
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.contact.objects import Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.path import PathPoint
from zeromethod.simulation.watch_camera import SimulatedWatchCamera

RIG = load_rig("contactless")
AWAY_MM = 1e4
APPEARS_S = 0.2


def coming(form: Form, diameter_mm: float, speed_mm_s: float, from_mm: float, **solid: float) -> ObjectPath:
    """An object that comes straight down at (70, 3) mm; before 0.2 s it is not there."""
    points = (
        (0.0, AWAY_MM, from_mm),
        (APPEARS_S, AWAY_MM, from_mm),
        (APPEARS_S, 70.0, from_mm),
        (APPEARS_S + from_mm / speed_mm_s, 70.0, 0.0),
    )
    path = tuple(PathPoint(round(1e9 * t), x, 3.0, -height) for t, x, height in points)
    return ObjectPath(Solid(form, diameter_mm / 2, albedo=0.2, **solid), path)


def watched(*objects: ObjectPath, seconds: float, rig: Rig = RIG) -> Iterator[tuple[float, Approach]]:
    """Time, s, and what is read of each frame, at 30 Hz."""
    camera, reader = SimulatedWatchCamera(rig, SimulatedClock()), WatchReader(RIG)
    camera.scenario = replace(camera.scenario, objects=objects)
    for frame in range(int(30 * seconds)):
        time_ns = round(1e9 * frame / 30)
        yield 1e-9 * time_ns, reader.take(camera.image(time_ns, frame), time_ns)
