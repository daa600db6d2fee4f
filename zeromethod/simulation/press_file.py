"""Press files: TOML in, checked paths out, or one line that says what is wrong."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError, model_validator

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.refusal import first_refusal, refused
from zeromethod.rig.tables import NotNegative, Positive, Share, Table
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.object_file import ObjectTable
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape
from zeromethod.toml_file import parse_toml, read_text

MAP_LIMIT = 4096
"""Most samples of a height map on a side."""

_NEEDED = {
    Shape.GAUSSIAN: ("sigma_mm",),
    Shape.BALL: ("radius_mm",),
    Shape.CONE: ("contact_radius_mm",),
    Shape.EDGE: ("sigma_mm", "length_mm"),
    Shape.MAP: ("pitch_mm", "file"),
}
"""Keys of each shape that must be given, its size first."""
_CONTACT = ("contact_mm", "angle_deg")
_ALLOWED = {
    Shape.GAUSSIAN: _CONTACT[:1],
    Shape.BALL: ("touches",),
    Shape.CONE: ("touches",),
    Shape.EDGE: _CONTACT,
    Shape.MAP: _CONTACT,
}
"""Keys of each shape that may be given."""


class PointTable(Table):
    """One point of a path."""

    time_s: NotNegative
    x_mm: float
    y_mm: float
    depth_mm: float


class PressTable(Table):
    """A press: its shape, the path it takes, and how much light is left where it touches.

    gaussian: soft pad; `contact_mm` > 0 makes it couple light out inside that radius. ball: of `radius_mm`;
    cone: or needle, in contact out to `contact_radius_mm`; `touches` makes either couple light out over its
    contact area. edge: straight, along `angle_deg` (from x towards y); couples out within `contact_mm` of
    its line. map: a .npy next to the press file, (rows along y, cols along x), times depth_mm.
    """

    shape: Literal["gaussian", "ball", "cone", "edge", "map"]
    path: Annotated[tuple[PointTable, ...], Field(min_length=1)]
    touch_reflectance: Share = 0.05
    sigma_mm: Positive | None = None
    radius_mm: Positive | None = None
    contact_radius_mm: Positive | None = None
    pitch_mm: Positive | None = None
    length_mm: Positive | None = None
    file: Path | None = None
    angle_deg: float = 0.0
    contact_mm: NotNegative = 0.0
    touches: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> PressTable:
        times = [point.time_s for point in self.path]
        if times != sorted(times):
            raise refused("path", times, "time_s must not fall along it")
        needed = _NEEDED[Shape(self.shape)]
        for key in needed:
            if getattr(self, key) is None:
                raise refused(key, None, f"needed for shape '{self.shape}'")
        known = {"shape", "path", "touch_reflectance", *needed, *_ALLOWED[Shape(self.shape)]}
        for key in type(self).model_fields:
            if key in self.model_fields_set - known:
                raise refused(key, getattr(self, key), f"not for shape '{self.shape}'")
        return self

    def press(self, where: str, folder: Path) -> PressPath:
        """Dent on its path; `folder`: where a map's file lies, `where` begins the message that refuses it."""
        samples = None if self.file is None else _load_map(f"{where}.file", folder / self.file)
        shape = Shape(self.shape)
        dent = Dent(
            shape, 0.0, 0.0, 0.0, getattr(self, _NEEDED[shape][0]), self.length_mm or 0.0, self.angle_deg,
            self.contact_mm, self.touch_reflectance, samples,
        )  # fmt: skip
        points = (PathPoint(round(p.time_s * 1e9), p.x_mm, p.y_mm, p.depth_mm) for p in self.path)
        return PressPath(dent, tuple(points), self.touches)


class Phase(Table):
    """A named part of the run."""

    name: Annotated[str, Field(min_length=1)]
    from_s: NotNegative
    to_s: Positive

    @model_validator(mode="after")
    def _forwards(self) -> Phase:
        if self.to_s <= self.from_s:
            raise refused("to_s", self.to_s, "above from_s")
        return self


class PressFile(Table):
    """A whole press file; `duration_s` defaults to the last time in it."""

    duration_s: Positive | None = None
    press: tuple[PressTable, ...] = ()
    object: tuple[ObjectTable, ...] = ()
    phase: tuple[Phase, ...] = ()

    def duration(self) -> float:
        """Seconds that a run of it lasts."""
        if self.duration_s is not None:
            return self.duration_s
        moved = [p.path[-1].time_s for p in self.press] + [p.path[-1].time_s for p in self.object]
        ends = moved + [p.to_s for p in self.phase]
        return max(ends, default=0.0) or 1.0


def _load_map(where: str, file: Path) -> Float:
    try:
        samples = np.load(file, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{where}: {file}: a .npy of numbers is needed ({error})") from error
    numbers = samples.ndim == 2 and samples.dtype.kind in "iuf" and np.isfinite(samples).all()
    if not (numbers and 2 <= min(samples.shape) <= max(samples.shape) <= MAP_LIMIT):
        allowed = f"a (rows, cols) array of 2 to {MAP_LIMIT} finite numbers on a side"
        raise InputError(f"{where}: {file}: shape {samples.shape}, {samples.dtype}: {allowed}")
    return np.asarray(samples, dtype=np.float64)


class PressFileContent(NamedTuple):
    """What a press file holds."""

    presses: tuple[PressPath, ...]
    objects: tuple[ObjectPath, ...]
    duration_s: float
    phases: tuple[Phase, ...]


def read_press_file(path: Path, asked: str) -> PressFileContent:
    """Content of a press file; `asked` is what the user called it.

    Raises InputError with one line.
    """
    names = ", ".join(sorted(p.stem for p in resource("calibration", "presses").glob("*.toml")))
    allowed = f"a readable press file or one of {names}"
    if not os.path.exists(path):
        raise InputError(f"press: {asked}: {allowed}")
    text = read_text(path, allowed)
    if not text.strip():
        raise InputError(
            f"{path}: empty: allowed: duration_s, [[press]], [[object]], [[phase]] (none.toml: no press)"
        )
    try:
        file = PressFile.model_validate(parse_toml(text, path))
    except ValidationError as error:
        raise InputError(f"{path}: {first_refusal(error, PressFile)}") from error
    presses = tuple(
        table.press(f"{path}: press[{index}]", path.parent) for index, table in enumerate(file.press)
    )
    objects = tuple(table.path_of(number) for number, table in enumerate(file.object))
    return PressFileContent(presses, objects, file.duration(), file.phase)
