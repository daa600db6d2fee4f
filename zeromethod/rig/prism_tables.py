"""Tables of a rig file for its rubber's shape: prism, teeth, mirror at rest, plates and gaps on its faces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import Index, NotNegative, Positive, Table, Vector2

MOST_TEETH = 40
_FLATTEST_DEG, _STEEPEST_DEG = 5.0, 85.0
"""Faces lie between these."""
_FaceAngle = Annotated[float, Field(gt=_FLATTEST_DEG, lt=_STEEPEST_DEG)]
_ONE_EACH = "base_deviation_mm", "pattern_deviation_deg", "camera_deviation_deg"


class Layer(Table):
    """One slab parallel to a prism face: plate, bond or air gap (index 1)."""

    index: Index
    thickness_mm: NotNegative


class RestSurface(Table):
    """Height of the undeformed mirror above z = 0, positive out of the rubber.

    flat; sphere (`radius_mm` > 0 bulges outwards, height 0 at `centre_mm`); cylinder (the same, its line of
    height 0 through `centre_mm`, turned by `axis_deg` from x towards y); map: a .npy of heights in mm, (rows
    along y, cols along x), bicubic between points, first point at `origin_mm`.
    """

    shape: Literal["flat", "sphere", "cylinder", "map"] = "flat"
    radius_mm: float | None = None
    centre_mm: Vector2 = (0.0, 0.0)
    axis_deg: float = 0.0
    file: Path | None = None
    pitch_mm: Positive | None = None
    origin_mm: Vector2 = (0.0, 0.0)

    @model_validator(mode="after")
    def _complete(self) -> RestSurface:
        round_ = self.shape in ("sphere", "cylinder")
        if round_ and not self.radius_mm:
            raise refused("radius_mm", self.radius_mm, f"a number other than 0 for shape {self.shape!r}")
        if self.shape == "map" and self.file is None:
            raise refused("file", None, "a .npy file for shape 'map'")
        if self.shape == "map" and self.pitch_mm is None:
            raise refused("pitch_mm", None, "a number above 0 for shape 'map'")
        if not round_ and self.radius_mm is not None:
            raise refused("radius_mm", self.radius_mm, "only with shape 'sphere' or 'cylinder'")
        if self.shape != "cylinder" and self.axis_deg:
            raise refused("axis_deg", self.axis_deg, "only with shape 'cylinder'")
        if self.shape != "map" and self.file is not None:
            raise refused("file", str(self.file), "only with shape 'map'")
        return self


class Teeth(Table):
    """Teeth of a saw: `count` small prisms side by side under the mirror, tooth 0 at P0.

    `base_mm` of rubber lie between mirror and valleys; the prism's angles are the teeth's. Deviations of
    single teeth from that, a number each: of the rubber above it, of its pattern and camera face's angle; and
    how well each of these is known, as standard deviations, where `[priors]` is not true of all.
    """

    count: Annotated[int, Field(ge=1, le=MOST_TEETH)]
    base_mm: NotNegative
    base_deviation_mm: tuple[float, ...] = ()
    pattern_deviation_deg: tuple[float, ...] = ()
    camera_deviation_deg: tuple[float, ...] = ()
    base_sigma_mm: tuple[NotNegative, ...] = ()
    pattern_sigma_deg: tuple[NotNegative, ...] = ()
    camera_sigma_deg: tuple[NotNegative, ...] = ()

    @model_validator(mode="after")
    def _one_each(self) -> Teeth:
        for least, keys in (
            (-1, _ONE_EACH),
            (0, [key.replace("_deviation_", "_sigma_") for key in _ONE_EACH]),
        ):
            for key in keys:
                values = getattr(self, key)
                if values and (len(values) != self.count or max(map(abs, values)) > 1.0):
                    allowed = f"{self.count} numbers from {least} to 1, one for each tooth, or none"
                    raise refused(key, list(values), allowed)
        if min(self.base_deviation_mm, default=0.0) < -self.base_mm:
            rule = f"at least -{self.base_mm:g}, as base_mm is {self.base_mm:g}"
            raise refused("base_deviation_mm", min(self.base_deviation_mm), rule)
        return self


class Prism(Table):
    """The rubber prism: angles of its faces to the mirror, one length, refractive index.

    pattern_angle_deg: of the pattern face, alpha0 at P0; camera_angle_deg: of the camera face, beta0 at R0.
    `pattern_length_mm` is the length of the pattern face, `mirror_length_mm` the paper's L0: exactly one.
    The prism spans -width_mm/2 <= y <= width_mm/2. With `teeth` it is a saw: many small prisms under one
    mirror.
    """

    pattern_angle_deg: _FaceAngle
    camera_angle_deg: _FaceAngle
    pattern_length_mm: Positive | None = None
    mirror_length_mm: Positive | None = None
    width_mm: Positive
    index: Annotated[float, Field(gt=1, le=4)]
    rest: RestSurface = RestSurface()
    teeth: Teeth | None = None

    def __repr__(self) -> str:
        angles = f"{self.pattern_angle_deg:g}/{self.camera_angle_deg:g} deg"
        return f"Prism({angles}, index {self.index:g}, {self.width_mm:g} mm wide)"

    @model_validator(mode="after")
    def _one_length(self) -> Prism:
        rule = "exactly one of pattern_length_mm and mirror_length_mm"
        if self.pattern_length_mm is None and self.mirror_length_mm is None:
            raise refused("pattern_length_mm", None, rule)
        if self.pattern_length_mm is not None and self.mirror_length_mm is not None:
            raise refused("mirror_length_mm", self.mirror_length_mm, rule)
        if self.teeth is not None and self.mirror_length_mm is None:
            raise refused("pattern_length_mm", self.pattern_length_mm, "mirror_length_mm with prism.teeth")
        return self

    @model_validator(mode="after")
    def _angles_of_teeth(self) -> Prism:
        for side, angle_deg in (("pattern", self.pattern_angle_deg), ("camera", self.camera_angle_deg)):
            key = f"{side}_deviation_deg"
            for away_deg in () if self.teeth is None else getattr(self.teeth, key):
                if not _FLATTEST_DEG < angle_deg + away_deg < _STEEPEST_DEG:
                    between = f"above {_FLATTEST_DEG:g} and below {_STEEPEST_DEG:g}"
                    rule = f"with {side}_angle_deg {angle_deg:g} {between}"
                    raise refused(f"teeth.{key}", away_deg, rule)
        return self
