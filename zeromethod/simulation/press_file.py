"""Press files: TOML in, checked paths out, or one line that says what is wrong."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.refusal import shown
from zeromethod.rig.tables import NotNegative, Positive, Share, Table
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape

_SIZES = ("sigma_mm", "radius_mm", "contact_radius_mm", "pitch_mm")

MAP_LIMIT = 4096
"""Most samples of a height map on a side."""


class PointTable(Table):
    """One point of a path."""

    time_s: NotNegative
    x_mm: float
    y_mm: float
    depth_mm: float


class PathTable(Table):
    """What every press has: a path and how much light is left where it touches."""

    path: Annotated[tuple[PointTable, ...], Field(min_length=1)]
    touch_reflectance: Share = 0.05

    @model_validator(mode="after")
    def _times_rise(self) -> PathTable:
        times = [point.time_s for point in self.path]
        if times != sorted(times):
            raise ValueError("time_s must not fall along the path")
        return self

    def points(self) -> tuple[PathPoint, ...]:
        """Return the path with times in ns."""
        return tuple(PathPoint(round(p.time_s * 1e9), p.x_mm, p.y_mm, p.depth_mm) for p in self.path)


class GaussianTable(PathTable):
    """Soft pad; `contact_mm` > 0 makes it couple light out inside that radius."""

    shape: Literal["gaussian"]
    sigma_mm: Positive
    contact_mm: NotNegative = 0.0


class BallTable(PathTable):
    """Ball of `radius_mm`; `touches`: couples light out over its contact area."""

    shape: Literal["ball"]
    radius_mm: Positive
    touches: bool = False


class ConeTable(PathTable):
    """Cone or needle in contact out to `contact_radius_mm`; `touches`: couples light out there."""

    shape: Literal["cone"]
    contact_radius_mm: Positive
    touches: bool = False


class EdgeTable(PathTable):
    """Straight edge along `angle_deg` (from x towards y); couples out within `contact_mm` of its line."""

    shape: Literal["edge"]
    sigma_mm: Positive
    length_mm: Positive
    angle_deg: float = 0.0
    contact_mm: NotNegative = 0.0


class MapTable(PathTable):
    """Height map from a .npy next to the press file: (rows along y, cols along x), times depth_mm."""

    shape: Literal["map"]
    file: Path
    pitch_mm: Positive
    angle_deg: float = 0.0
    contact_mm: NotNegative = 0.0


class Phase(Table):
    """A named part of the run."""

    name: Annotated[str, Field(min_length=1)]
    from_s: NotNegative
    to_s: Positive

    @model_validator(mode="after")
    def _forwards(self) -> Phase:
        if self.to_s <= self.from_s:
            raise ValueError("to_s must be greater than from_s")
        return self


AnyPress = GaussianTable | BallTable | ConeTable | EdgeTable | MapTable


class PressFile(Table):
    """A whole press file; `duration_s` defaults to the last time in it."""

    duration_s: Positive | None = None
    press: tuple[Annotated[AnyPress, Field(discriminator="shape")], ...] = ()
    phase: tuple[Phase, ...] = ()

    def duration(self) -> float:
        """Seconds that a run of it lasts."""
        if self.duration_s is not None:
            return self.duration_s
        ends = [p.path[-1].time_s for p in self.press] + [p.to_s for p in self.phase]
        return max(ends, default=0.0) or 1.0


def _load_map(where: str, file: Path) -> Float:
    try:
        samples = np.load(file, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{where}: {file}: a .npy of numbers is needed ({error})") from error
    allowed = f"a (rows, cols) array of 2 to {MAP_LIMIT} finite numbers on a side"
    if samples.ndim != 2 or samples.dtype.kind not in "iuf":
        raise InputError(f"{where}: {file}: shape {samples.shape}, {samples.dtype}: {allowed}")
    if not 2 <= min(samples.shape) <= max(samples.shape) <= MAP_LIMIT or not np.isfinite(samples).all():
        raise InputError(f"{where}: {file}: shape {samples.shape} or not finite: {allowed}")
    return np.asarray(samples, dtype=np.float64)


def _path_of(where: str, folder: Path, table: AnyPress) -> PressPath:
    given = table.model_dump()
    samples = _load_map(f"{where}.file", folder / table.file) if isinstance(table, MapTable) else None
    dent = Dent(
        Shape(table.shape), 0.0, 0.0, 0.0,
        size_mm=next(given[key] for key in _SIZES if key in given),
        length_mm=given.get("length_mm", 0.0), angle_deg=given.get("angle_deg", 0.0),
        contact_mm=given.get("contact_mm", 0.0), touch_reflectance=table.touch_reflectance, map=samples,
    )  # fmt: skip
    return PressPath(dent, table.points(), given.get("touches", False))


def _complaint(error: ValidationError) -> str:
    """`key: value: what is allowed` of the first thing that is wrong with a press file."""
    first = error.errors(include_url=False)[0]
    # The union's tag stands in the place as if it were a key.
    key = ".".join(str(part) for part in first["loc"] if part not in set(Shape)) or "file"
    if first["type"] == "missing":
        return f"{key}: missing"
    if first["type"].startswith("union_tag"):
        return f"{key}.shape: {shown(first['input'].get('shape', 'missing'))}: one of {', '.join(Shape)}"
    if first["type"] == "too_short":
        return f"{key}: empty: at least one point"
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input ")
    plain = isinstance(first["input"], str | int | float | bool)
    return f"{key}: {shown(first['input'])}: {message}" if plain else f"{key}: {message}"


def read_press_file(path: Path, asked: str) -> tuple[tuple[PressPath, ...], float, tuple[Phase, ...]]:
    """(presses, duration s, phases) of a press file; `asked` is what the user called it.

    Raises InputError with one line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        names = ", ".join(sorted(p.stem for p in resource("calibration", "presses").glob("*.toml")))
        raise InputError(f"press: {asked}: a readable press file or one of {names}") from error
    if not text.strip():
        raise InputError(
            f"{path}: empty: allowed: duration_s, [[press]], [[phase]] (the packaged none.toml: no press)"
        )
    try:
        file = PressFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not TOML: {error}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {_complaint(error)}") from error
    presses = tuple(
        _path_of(f"{path}: press.{index}", path.parent, table) for index, table in enumerate(file.press)
    )
    return presses, file.duration(), file.phase
