"""Table of a press in a press file: a load on the rubber, or a dent by a formula or a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import Count, NotNegative, Positive, Share, Table
from zeromethod.simulation.load_path import LoadPath
from zeromethod.simulation.loads import LEAST_WIDTH_MM, MOST_WIDTHS, Form, Load
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent, Shape

MAP_LIMIT = 4096
"""Most samples of a height map on a side."""

_NEEDED: dict[Form | Shape, tuple[str, ...]] = {
    Form.LOAD: ("width_mm",),
    Form.RING: ("width_mm", "radius_mm"),
    Form.ROD: ("width_mm", "length_mm"),
    Form.ROUGH: ("width_mm", "radius_mm", "seed"),
    Shape.GAUSSIAN: ("sigma_mm",),
    Shape.BALL: ("radius_mm",),
    Shape.CONE: ("contact_radius_mm",),
    Shape.EDGE: ("sigma_mm", "length_mm"),
    Shape.MAP: ("pitch_mm", "file"),
}
"""Keys of each shape that must be given, its size first."""
_CONTACT = ("contact_mm", "angle_deg")
_ALLOWED: dict[Form | Shape, tuple[str, ...]] = {
    Form.LOAD: _CONTACT[:1],
    Form.RING: _CONTACT[:1],
    Form.ROD: _CONTACT,
    Form.ROUGH: _CONTACT[:1],
    Shape.GAUSSIAN: _CONTACT[:1],
    Shape.BALL: ("touches",),
    Shape.CONE: ("touches",),
    Shape.EDGE: _CONTACT,
    Shape.MAP: _CONTACT,
}
"""Keys of each shape that may be given."""


class PointTable(Table):
    """One point of a path: how deep the press is or, of a load, with what force."""

    time_s: NotNegative
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    force_n: float | None = None


class PressTable(Table):
    """A press: its shape, the path it takes, and how much light is left where it touches.

    Loads press the rig's rubber. load: a Gaussian pressure exp(-r^2 / 2 width^2). ring: one smeared along a
    circle of `radius_mm`; rod: along a line of `length_mm`, at `angle_deg` from x towards y. rough: loads of
    that width and of any force, (radius / width)^2 of them strewn over a disc of `radius_mm`, by `seed`.
    All points of their path have `depth_mm`, of the deepest point, what the rubber's other faces add
    included, or all `force_n`.
    Dents by formula, whatever the rubber. ball: of `radius_mm`; cone: or needle, in contact out to
    `contact_radius_mm`; those of a half-space; `touches` makes either couple light out over its contact area.
    No rubber makes these: gaussian; edge: straight, along `angle_deg`; map: a .npy next to the press file,
    (rows along y, cols along x), times depth_mm.
    `contact_mm` > 0 makes the others couple light out inside that radius, edge and rod within that of
    their line.
    """

    shape: Literal["load", "ring", "rod", "rough", "gaussian", "ball", "cone", "edge", "map"]
    path: Annotated[tuple[PointTable, ...], Field(min_length=1)]
    touch_reflectance: Share = 0.05
    width_mm: Annotated[float, Field(ge=LEAST_WIDTH_MM)] | None = None
    sigma_mm: Positive | None = None
    radius_mm: Positive | None = None
    contact_radius_mm: Positive | None = None
    pitch_mm: Positive | None = None
    length_mm: Positive | None = None
    file: Path | None = None
    seed: Count | None = None
    angle_deg: float = 0.0
    contact_mm: NotNegative = 0.0
    touches: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> PressTable:
        times = [point.time_s for point in self.path]
        if times != sorted(times):
            raise refused("path", times, "time_s must not fall along it")
        kind = self.kind
        for key in _NEEDED[kind]:
            if getattr(self, key) is None:
                raise refused(key, None, f"needed for shape '{self.shape}'")
        known = {"shape", "path", "touch_reflectance", *_NEEDED[kind], *_ALLOWED[kind]}
        for key in type(self).model_fields:
            if key in self.model_fields_set - known:
                raise refused(key, getattr(self, key), f"not for shape '{self.shape}'")
        self._check_path()
        for key in ("radius_mm", "length_mm"):
            size, most = getattr(self, key), MOST_WIDTHS * (self.width_mm or np.inf)
            if size is not None and size > most:
                raise refused(key, size, f"at most {MOST_WIDTHS} x width_mm = {most:g}")
        return self

    def _check_path(self) -> None:
        given = {(point.depth_mm is None, point.force_n is None) for point in self.path}
        if isinstance(self.kind, Form) and given not in ({(False, True)}, {(True, False)}):
            raise refused("path", None, "depth_mm at every point, or force_n at every point")
        if isinstance(self.kind, Shape) and given != {(False, True)}:
            raise refused("path", None, f"depth_mm at every point for shape '{self.shape}', and no force_n")

    @property
    def kind(self) -> Form | Shape:
        """What it is of the two."""
        return Form(self.shape) if self.shape in list(Form) else Shape(self.shape)

    def press(self, where: str, folder: Path) -> PressPath | LoadPath:
        """Dent or load on its path; `folder`: where a map's file lies, `where`: begins its refusal."""
        by_force = self.path[0].force_n is not None
        points = tuple(
            PathPoint(round(p.time_s * 1e9), p.x_mm, p.y_mm, (p.force_n if by_force else p.depth_mm) or 0.0)
            for p in self.path
        )
        kind = self.kind
        if isinstance(kind, Form):
            load = Load(
                kind, self.width_mm or 0.0, self.radius_mm or 0.0, self.length_mm or 0.0, self.angle_deg,
                self.seed or 0, self.contact_mm, self.touch_reflectance,
            )  # fmt: skip
            return LoadPath(load, points, by_force)
        samples = None if self.file is None else _load_map(f"{where}.file", folder / self.file)
        dent = Dent(
            kind, 0.0, 0.0, 0.0, getattr(self, _NEEDED[kind][0]), self.length_mm or 0.0, self.angle_deg,
            self.contact_mm, self.touch_reflectance, samples,
        )  # fmt: skip
        return PressPath(dent, points, self.touches)


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
