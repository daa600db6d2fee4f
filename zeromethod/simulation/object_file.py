"""Tables of press files for hard objects, which are solved in contact with the rubber."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import Angle, Count, NotNegative, Positive, Table
from zeromethod.simulation.contact.objects import ALBEDO, Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.contact.texture import Texture, Weave
from zeromethod.simulation.path import PathPoint

_NEEDED = {
    Form.BALL: ("radius_mm",),
    Form.CONE: ("flank_deg",),
    Form.PUNCH: ("radius_mm",),
    Form.EDGE: ("radius_mm", "length_mm"),
    Form.FINGER: ("radius_mm", "ridge_pitch_mm", "ridge_height_mm"),
    Form.BARS: ("radius_mm", "ridge_pitch_mm", "ridge_height_mm"),
    Form.TEXTURE: ("radius_mm", "weave", "pitch_mm", "tip_mm"),
}
"""Keys of each shape that must be given."""
_ALLOWED = {
    Form.BALL: ("adhesion_j_m2",),
    Form.CONE: (),
    Form.PUNCH: (),
    Form.EDGE: ("angle_deg",),
    Form.FINGER: ("angle_deg",),
    Form.BARS: ("angle_deg",),
    Form.TEXTURE: ("angle_deg", "height_mm", "seed"),
}
"""Keys of each shape that may be given."""


class ObjectPoint(Table):
    """One point of an object's path: how deep it is held, or with what force it is pressed."""

    time_s: NotNegative
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    force_n: float | None = None


class ObjectTable(Table):
    """A hard object: its shape, what it scatters, the path it takes.

    ball: of `radius_mm`, with `adhesion_j_m2` one that sticks (JKR). cone: its flank `flank_deg` from the
    surface. punch: a flat round face of `radius_mm`. edge: a rod of `radius_mm`, `length_mm` long along
    `angle_deg` (from x towards y). finger: a ball with ridges `ridge_pitch_mm` apart along `angle_deg`.
    bars: a punch with flat, sharp ridges like that, half a pitch wide. texture: a flat round face of tips, on
    average `pitch_mm` apart, rounded with `tip_mm`, their heights spread by `height_mm`, by `seed`; `weave`
    "brush" (a square array), "woven" (yarns that cross), "pile" (fibres at random), "sandpaper" (grains of
    any size). All points of a path have `depth_mm`, of the lowest point below the surface at rest, or all
    `force_n`. `friction`: force along x that the rubber is dragged with, over that into it.
    """

    shape: Literal["ball", "cone", "punch", "edge", "finger", "bars", "texture"]
    path: Annotated[tuple[ObjectPoint, ...], Field(min_length=1)]
    albedo: Literal["black", "grey", "white"] = "black"
    radius_mm: Positive | None = None
    flank_deg: Annotated[float, Field(gt=0, lt=80)] | None = None
    length_mm: Positive | None = None
    ridge_pitch_mm: Positive | None = None
    ridge_height_mm: Positive | None = None
    weave: Literal["brush", "pile", "woven", "sandpaper"] | None = None
    pitch_mm: Positive | None = None
    tip_mm: Positive | None = None
    height_mm: NotNegative = 0.0
    seed: Count = 0
    adhesion_j_m2: NotNegative = 0.0
    angle_deg: Angle = 0.0
    friction: float = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> ObjectTable:
        times = [point.time_s for point in self.path]
        if times != sorted(times):
            raise refused("path", times, "time_s must not fall along it")
        given = {(point.depth_mm is None, point.force_n is None) for point in self.path}
        if given not in ({(False, True)}, {(True, False)}):
            raise refused("path", None, "depth_mm at every point, or force_n at every point")
        form = Form(self.shape)
        for key in _NEEDED[form]:
            if getattr(self, key) is None:
                raise refused(key, None, f"needed for shape '{self.shape}'")
        known = {"shape", "path", "albedo", "friction", *_NEEDED[form], *_ALLOWED[form]}
        for key in type(self).model_fields:
            if key in self.model_fields_set - known:
                raise refused(key, getattr(self, key), f"not for shape '{self.shape}'")
        return self

    def path_of(self, number: int) -> ObjectPath:
        """The object on its path; `number`: which of the file's it is."""
        solid = Solid(
            Form(self.shape),
            self.radius_mm or 0.0,
            self.flank_deg or 0.0,
            self.length_mm or 0.0,
            self.angle_deg,
            self.ridge_pitch_mm or 0.0,
            self.ridge_height_mm or 0.0,
            self.adhesion_j_m2,
            ALBEDO[self.albedo],
            self.friction,
            self._texture(),
        )
        by_force = self.path[0].force_n is not None
        points = (
            PathPoint(round(p.time_s * 1e9), p.x_mm, p.y_mm, (p.force_n if by_force else p.depth_mm) or 0.0)
            for p in self.path
        )
        return ObjectPath(solid, tuple(points), by_force, number)

    def _texture(self) -> Texture | None:
        if self.weave is None or self.pitch_mm is None or self.tip_mm is None:
            return None
        return Texture(Weave(self.weave), self.pitch_mm, self.tip_mm, self.height_mm, self.seed)
