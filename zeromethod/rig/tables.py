"""Tables of a rig file but those of the devices and of the simulated bench: every key, unit and bound.

One pydantic model per TOML table. All models are frozen, refuse unknown keys and NaN. Lengths in
mm, angles in degrees, times in s, camera and LCD pixels in px (centres at integers). The world
frame is that of `zeromethod.optics`: origin on the edge P0 where pattern face and mirror meet,
x along the mirror towards the camera face, z out of the rubber, y = z cross x.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from zeromethod.errors import InputError
from zeromethod.rig.refusal import first_refusal, refused, unknown_key

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
LitShare = Annotated[float, Field(gt=0, le=1)]
Angle = Annotated[float, Field(ge=-360, le=360)]
Rate = Annotated[float, Field(gt=0, le=10000)]
Lag = Annotated[float, Field(ge=0, le=10)]
Luminance = Annotated[float, Field(ge=0, le=1000)]
Count = Annotated[int, Field(ge=0)]
Text = Annotated[str, Field(min_length=1)]
Index = Annotated[float, Field(ge=1, le=4)]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]


class Table(BaseModel):
    """A TOML table: frozen, strict about its keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, **values: Any) -> None:
        """Table of these values; raises InputError, one line, for the first that is not allowed."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            kind = type(self)
            raise InputError(f"{kind.__name__}: {first_refusal(error, kind)}") from None

    # a table inside another is checked with it, not by its own __init__
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __str__(self) -> str:
        return repr(self)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy with unchecked values in place of its own; refuses keys that the table does not have."""
        fields = type(self).model_fields
        unknown = [key for key in update or () if key not in fields]
        if unknown and self.model_config["extra"] == "forbid":
            raise InputError(unknown_key((type(self).__name__, unknown[0]), list(fields)))
        return super().model_copy(update=update, deep=deep)

    def given(self) -> dict[str, Any]:
        """Keys of the schema that were given, a driver's own options left out."""
        return {key: getattr(self, key) for key in self.model_fields_set & set(type(self).model_fields)}


Support = Literal["bonded", "sliding", "free"]


class FaceSupports(Table):
    """What holds each face of the prism but the mirror.

    "bonded": held fast; "sliding": held without friction, never lifted off; "free": not held. `ends`: both
    faces across y. Raises InputError where nothing keeps the prism from moving.
    """

    pattern: Support = "bonded"
    camera: Support = "bonded"
    ends: Support = "free"

    @model_validator(mode="after")
    def _held(self) -> FaceSupports:
        faces = self.pattern, self.camera, self.ends
        if "bonded" not in faces and faces[:2] != ("sliding", "sliding"):
            rule = "one face 'bonded', or pattern and camera 'sliding': else nothing holds the prism"
            raise refused("pattern", self.pattern, rule)
        return self


class Rubber(Table):
    """How the rubber yields to what presses on it.

    Without `youngs_modulus_mpa` no force is read, and the simulated bench takes 1 MPa; `_sigma` are standard
    deviations. `support`: "free", a half-space: so thick that its other faces do not matter; "bonded" or
    "sliding", a layer of `thickness_mm` on a rigid base, bonded to it or sliding on it; by a table per face:
    the prism. Without it what holds the rubber is not known: that counts in sigma, and the simulated bench
    takes a half-space. `body` "none": what is seen is no elastic body, and only a declared rest gives depth
    its constant.
    """

    body: Literal["elastic", "none"] = "elastic"
    youngs_modulus_mpa: Positive | None = None
    youngs_modulus_sigma_mpa: NotNegative = 0.0
    poisson: Annotated[float, Field(ge=0, le=0.5)] = 0.49
    poisson_sigma: NotNegative = 0.0
    support: Support | FaceSupports | None = None
    thickness_mm: Positive | None = None
    thickness_sigma_mm: NotNegative = 0.0

    @property
    def not_known(self) -> str:
        """What to tell people where what holds the rubber is not known, "" where it is."""
        if self.support is not None or self.body == "none":
            return ""
        return (
            "rubber.support is not given: what holds the rubber is not known, and counts in sigma: give "
            '"free", "bonded", "sliding" or a table per face ([rubber] in docs/rig-files.md)'
        )

    @model_validator(mode="after")
    def _elastic(self) -> Rubber:
        values = self.model_dump()
        for key in ("support", "thickness_mm", "youngs_modulus_mpa") if self.body == "none" else ():
            if values[key] is not None:
                raise refused(key, values[key], "not given with rubber.body 'none', which is not elastic")
        return self

    @model_validator(mode="after")
    def _thick(self) -> Rubber:
        layer = self.support in ("bonded", "sliding")
        if layer and self.thickness_mm is None:
            raise refused("thickness_mm", None, f"a number above 0 for support '{self.support}'")
        if not layer and self.thickness_mm is not None:
            raise refused("thickness_mm", self.thickness_mm, "only with support 'bonded' or 'sliding'")
        return self


LEAST_STEP = 8
"""Fewest pictures per period of a moving target: of fewer, two in one exposure leave too little contrast."""


class TargetSpec(Table):
    """The target: the picture that the camera should see, in camera pixels.

    Light = mean +- contrast x mean; the period is even and a node lies every half period. `step`: the target
    moves from drawn picture to drawn picture by 1 / step of a period along u and 2 / step along v, a period
    (two) there and back; 0: it stands still. `carry`: each LCD pixel shows in its next picture the light that
    rounding to whole codes left out.
    """

    kind: Literal["cosines", "checker", "lattice", "noise"] = "cosines"
    period_px: Annotated[int, Field(ge=8, le=64, multiple_of=2)] = 16
    mean: Annotated[float, Field(gt=0, lt=1)] = 0.5
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.9
    step: Annotated[int, Field(ge=0, le=64)] = 0
    carry: bool = False

    @model_validator(mode="after")
    def _displayable(self) -> TargetSpec:
        if 0 < self.step < LEAST_STEP:
            raise refused("step", self.step, f"0, or {LEAST_STEP} to 64")
        if self.step and self.kind == "noise":
            raise refused("step", self.step, "0 for target.kind 'noise', which has no phase")
        if self.mean * (1 + self.contrast) > 1 + 1e-9:
            raise refused("contrast", self.contrast, f"at most 1 / mean - 1 = {1 / self.mean - 1:.6g}")
        return self


class ControlSpec(Table):
    """The loop: which controller, with what gain.

    `gain` 0..1: share of each correction applied at once (composition: filter's upper limit;
    integrator: its gain); `leak` is the integrator's alone, per frame. `strips` "edges": coded strips at two
    edges of the view identify the pictures that a frame was exposed to; "auto": so they do unless camera and
    display are the simulated ones. `follow_bench`: motion of camera, LCD or prism is corrected where it shows
    whole, while nothing presses or by two places known to rest. `burst`: whether coded pictures read the warp
    where none can null it (folds, what is too fine for the LCD): never, when needed, or again and again.
    `lamp`: the LCD is white inside contacts. `rubbing`: what touches is a texture (cloth, pile, bristles,
    grains), whose state of contact is read. Controller "passive": the picture at rest stays, as on a printed
    pattern; nothing is nulled, and strips, bursts and lamp are not drawn.
    """

    controller: Literal["composition", "integrator", "passive"] = "composition"
    gain: Annotated[float, Field(gt=0, le=1)] = 1.0
    leak: Annotated[float, Field(ge=0, lt=1)] = 0.01
    timeout_s: Positive = 1.0
    strips: Literal["auto", "none", "edges"] = "auto"
    follow_bench: bool = False
    burst: Literal["never", "when-needed", "always"] = "when-needed"
    lamp: bool = True
    rubbing: bool = False

    @property
    def passive(self) -> bool:
        """Whether one picture stays for ever, and nothing is nulled."""
        return self.controller == "passive"

    @property
    def reads(self) -> str:
        """How the picture is when it is read, in a word for people: nulled, or just read."""
        return "read" if self.passive else "nulled"


class LightSpec(Table):
    """What lights the pattern, and what else gives light. Reading goes by `source` alone.

    source "lcd": its own backlight. "lamp": a lamp at the camera's lens shines on a printed pattern by way of
    the mirror; its light is reflected twice, and is as dense on the print as the mirror focuses it.
    The rest is the simulated bench's. `brightness`: of LCD or lamp, 1: as `simulation.peak_grey_share` has
    it. Luminances over that of the white LCD at brightness 1: `room`, all that surrounds the prism, steady;
    `mains`, the same by lamps that swing to nothing and back `mains_hz` times a second, on average; `sun`,
    the same by a sun that grows by a tenth a minute and that clouds take to a fifth and back every
    `cloud_s`; `ring`, of a ring light round the lens with radii `ring_mm`, inner and outer.
    """

    source: Literal["lcd", "lamp"] = "lcd"
    brightness: Annotated[float, Field(gt=0, le=10)] = 1.0
    room: Luminance = 0.0
    mains: Luminance = 0.0
    mains_hz: Rate = 100.0
    sun: Luminance = 0.0
    cloud_s: Positive = 2.0
    ring: Luminance = 0.0
    ring_mm: tuple[Positive, Positive] = (20.0, 30.0)

    @model_validator(mode="after")
    def _rings(self) -> LightSpec:
        if self.ring_mm[0] >= self.ring_mm[1]:
            raise refused("ring_mm", list(self.ring_mm), "inner, outer with inner below outer")
        return self

    @property
    def by_mirror(self) -> bool:
        """Whether the light comes to the pattern by way of the mirror."""
        return self.source == "lamp"


class KnownRest(Table):
    """A rectangle of the mirror known to stay at rest (a clamped rim): x and y from, to in mm."""

    x_mm: Vector2
    y_mm: Vector2

    @model_validator(mode="after")
    def _not_empty(self) -> KnownRest:
        for key, (start, end) in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if start >= end:
                raise refused(key, [start, end], "from, to with from below to")
        return self


class PriorSpec(Table):
    """How well the geometry in the file is known before it is calibrated: standard deviations, 0 = exact.

    The defaults are those of calipers, a protractor and data sheets. Of the LCD: its place along the pattern
    face and along y, its turn, its wedge (about either axis), the gap before it. Of the camera: its place
    along each axis, its direction either way, its roll, its focal length (or pixel size) in percent, one
    focal length against the other in percent, its principal point, the distortion k1. Of the prism: its
    index, the pattern face's angle, the camera face's less that one, the length; of a curved mirror its
    radius in percent, its centre along x and y, a cylinder's axis. Of a saw the rubber above all valleys, and
    what single teeth have besides: of that, and of each face's angle.
    """

    display_along_mm: NotNegative = 1.2
    display_across_mm: NotNegative = 1.2
    display_turn_deg: NotNegative = 0.6
    display_wedge_deg: NotNegative = 0.15
    gap_mm: NotNegative = 0.17
    camera_place_mm: NotNegative = 3.0
    camera_aim_deg: NotNegative = 0.6
    camera_roll_deg: NotNegative = 0.6
    focal_percent: NotNegative = 1.2
    focal_aspect_percent: NotNegative = 0.05
    centre_px: NotNegative = 15.0
    distortion_k1: NotNegative = 0.3
    index: NotNegative = 0.006
    angle_deg: NotNegative = 0.3
    faces_difference_deg: NotNegative = 0.18
    length_mm: NotNegative = 0.05
    rest_radius_percent: NotNegative = 1.0
    rest_centre_mm: NotNegative = 0.3
    rest_axis_deg: NotNegative = 0.3
    teeth_base_mm: NotNegative = 0.05
    tooth_base_mm: NotNegative = 0.02
    tooth_angle_deg: NotNegative = 0.1


MARK_HALF_PX = 16
"""Camera px from the middle of a mark's window to its border."""


class SurfaceSpec(Table):
    """Reading depth: where the rubber is known to be at rest; without, loads give depth its constant.

    `marks_px`: camera pixels (u, v) of marks on the prism's frame that the camera sees itself, not by way of
    the LCD; they are watched for motion of the camera against the prism.
    """

    known_rest: tuple[KnownRest, ...] = ()
    marks_px: tuple[Vector2, ...] = ()
