"""What a rig file may say: every table, key, unit and bound.

One pydantic model per TOML table. All models are frozen, refuse unknown keys and NaN. Lengths in
mm, angles in degrees, times in s, camera and LCD pixels in px (centres at integers). The world
frame is that of `zeromethod.optics`: origin on the edge P0 where pattern face and mirror meet,
x along the mirror towards the captured face, z out of the rubber, y = z cross x.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from zeromethod.rig.refusal import refused

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
LitShare = Annotated[float, Field(gt=0, le=1)]
Exponent = Annotated[float, Field(ge=0.2, le=5)]
Angle = Annotated[float, Field(ge=-360, le=360)]
Tilt = Annotated[float, Field(ge=-45, le=45)]
Rate = Annotated[float, Field(gt=0, le=10000)]
Focal = Annotated[float, Field(ge=1, le=1e7)]
Lag = Annotated[float, Field(ge=0, le=10)]
Delay = Annotated[float, Field(ge=-1, le=10)]
Count = Annotated[int, Field(ge=0)]
Text = Annotated[str, Field(min_length=1)]
Index = Annotated[float, Field(ge=1, le=4)]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]


class Table(BaseModel):
    """A TOML table: frozen, strict about its keys, no NaN or infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def given(self) -> dict[str, Any]:
        """Keys of the schema that were given, a driver's own options left out."""
        return {key: getattr(self, key) for key in self.model_fields_set & set(type(self).model_fields)}


class Layer(Table):
    """One slab parallel to a prism face: plate, bond or air gap (index 1)."""

    index: Index
    thickness_mm: NotNegative


class RestSurface(Table):
    """Height of the undeformed mirror above z = 0, positive out of the rubber.

    flat; sphere (`radius_mm` > 0 bulges outwards, height 0 at `centre_mm`); map: a .npy of heights
    in mm, (rows along y, cols along x), bicubic between points, first point at `origin_mm`.
    """

    shape: Literal["flat", "sphere", "map"] = "flat"
    radius_mm: float | None = None
    centre_mm: Vector2 = (0.0, 0.0)
    file: Path | None = None
    pitch_mm: Positive | None = None
    origin_mm: Vector2 = (0.0, 0.0)

    @model_validator(mode="after")
    def _complete(self) -> RestSurface:
        if self.shape == "sphere" and not self.radius_mm:
            raise refused("radius_mm", self.radius_mm, "a number other than 0 for shape 'sphere'")
        if self.shape == "map" and self.file is None:
            raise refused("file", None, "a .npy file for shape 'map'")
        if self.shape == "map" and self.pitch_mm is None:
            raise refused("pitch_mm", None, "a number above 0 for shape 'map'")
        if self.shape != "sphere" and self.radius_mm is not None:
            raise refused("radius_mm", self.radius_mm, "only with shape 'sphere'")
        if self.shape != "map" and self.file is not None:
            raise refused("file", str(self.file), "only with shape 'map'")
        return self


class Prism(Table):
    """The rubber: angles of its faces to the mirror, one length, index.

    pattern_angle_deg: alpha0 at P0; captured_angle_deg: beta0 at R0. `leg_mm` is the length of the
    pattern face, `mirror_length_mm` the paper's L0: give exactly one. The prism spans
    -width_mm/2 <= y <= width_mm/2.
    """

    pattern_angle_deg: Annotated[float, Field(gt=5, lt=85)]
    captured_angle_deg: Annotated[float, Field(gt=5, lt=85)]
    leg_mm: Positive | None = None
    mirror_length_mm: Positive | None = None
    width_mm: Positive
    index: Annotated[float, Field(gt=1, le=4)]
    rest: RestSurface = RestSurface()

    @model_validator(mode="after")
    def _one_length(self) -> Prism:
        rule = "exactly one of leg_mm and mirror_length_mm"
        if self.leg_mm is None and self.mirror_length_mm is None:
            raise refused("leg_mm", None, rule)
        if self.leg_mm is not None and self.mirror_length_mm is not None:
            raise refused("mirror_length_mm", self.mirror_length_mm, rule)
        return self


class DisplaySpec(Table):
    """The LCD: `driver` and its own options, then what the panel is and where it lies.

    The panel lies parallel to the pattern face behind all `pattern_layers`, then tilted by
    `tilt_deg` (about the face's along direction, about y) round its centre. `centre_mm`: the panel's
    centre as (distance from P0 along the pattern face, y). With `turn_deg` 0 columns grow away from
    P0 and rows with y; `turn_deg` turns columns towards rows (+90: columns grow with y);
    `mirrored` flips the columns before turning.

    Timing: the first row starts to change `latency_s` after the presentation time (by the camera's stamps:
    below zero where these come early), the last
    `scanout_s` later (default one refresh; `scan` "down" = row 0 first); light follows a change
    exponentially, `rise_s` from 10 to 90 %. Response: light = (code/255)^gamma, or `response_light`,
    the light (0..1, rising) at equally spaced codes 0..255; where the view's angle changes it over the panel,
    raised to `response_exponent`, rows of numbers on a lattice whose corners are the panel's corner pixels,
    bilinear between. `fill` = lit share of the pixel pitch
    (columns, rows); stripes "rgb" splits a pixel into three along the columns. Polarisation: angle of
    the emitted light's field to y in the panel's plane (0 = s at the mirror, 90 = p);
    None = unpolarised.
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    driver: Text = "simulated"
    columns: Annotated[int, Field(ge=16, le=16384)]
    rows: Annotated[int, Field(ge=16, le=16384)]
    pitch_mm: Positive
    centre_mm: Vector2
    turn_deg: Angle = 0.0
    mirrored: bool = False
    tilt_deg: tuple[Tilt, Tilt] = (0.0, 0.0)
    refresh_hz: Rate
    latency_s: Delay = 0.0
    scanout_s: Lag | None = None
    scan: Literal["down", "up"] = "down"
    rise_s: Lag = 0.0
    gamma: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    response_light: tuple[Share, ...] | None = None
    response_exponent: tuple[tuple[Exponent, ...], ...] | None = None
    fill: tuple[LitShare, LitShare] = (1.0, 1.0)
    stripes: Literal["none", "rgb"] = "none"
    polarisation_deg: Angle | None = None

    @model_validator(mode="after")
    def _rising(self) -> DisplaySpec:
        light = self.response_light
        if light is not None and (len(light) < 2 or any(b <= a for a, b in pairwise(light))):
            raise refused(
                "response_light", list(light), "two or more numbers from 0 to 1, each above the last"
            )
        rows = self.response_exponent
        if rows is not None and (len(rows) < 2 or len(rows[0]) < 2 or len({len(row) for row in rows}) > 1):
            allowed = "two or more rows of two or more numbers, all of one length"
            raise refused("response_exponent", [list(row) for row in rows], allowed)
        return self


class Noise(Table):
    """Camera noise at the camera's own bit depth: variance = read_grey^2 + grey / electrons_per_grey."""

    read_grey: NotNegative = 0.0
    electrons_per_grey: Positive | None = None
    black_grey: NotNegative = 0.0


class CameraSpec(Table):
    """The camera: `driver` and its own options, then pixels, projection and pose, timing, noise.

    perspective: OpenCV's pinhole, `focal_px` (fx, fy), `centre_px` (cx, cy), `distortion`
    (k1, k2, p1, p2, k3), optical centre at `position_mm`. orthographic ("at infinity", as in the
    paper): parallel rays, `pixel_mm` apart; the pixel `centre_px` looks at `look_at_mm`.
    The optical axis points from `position_mm` to `look_at_mm`; with `roll_deg` 0 v runs along world +y
    (made perpendicular to the axis) and u = v x axis; positive roll turns u towards v. Pixels are
    exposed all at once (global shutter). `psf_px`: Gaussian sigma of lens and defocus, camera px.

    What a real camera is set to, where its driver can: `gain` in the device's own units, `pixel_format` by
    its GenICam name, `region_px` (first column, first row, columns, rows) of the sensor, and `trigger`: runs
    "free", is fired by "software" for each frame, or by "hardware" through an input line. `latency_s`: from
    the end of an exposure until its frame is received, at the least.

    `rest_map`: file of the LCD position that every pixel was measured to see by the mirror at rest (`.npz`
    of `zeromethod calibrate decode`, `arrays.h5` of a calibration). Readings then start from there, and each
    node has the ray that sees it so; without, both are those of the geometry.
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    driver: Text = "simulated"
    columns: Annotated[int, Field(ge=64, le=16384)]
    rows: Annotated[int, Field(ge=64, le=16384)]
    bits: Literal[8, 10, 12, 14, 16] = 8
    projection: Literal["perspective", "orthographic"]
    focal_px: tuple[Focal, Focal] | None = None
    pixel_mm: Positive | None = None
    centre_px: Vector2
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    position_mm: Vector3
    look_at_mm: Vector3
    roll_deg: Angle = 0.0
    rate_hz: Rate
    exposure_s: Positive
    latency_s: Lag = 0.0
    gain: NotNegative | None = None
    pixel_format: Text | None = None
    region_px: tuple[Count, Count, Count, Count] | None = None
    trigger: Literal["free", "software", "hardware"] = "free"
    psf_px: NotNegative = 0.0
    noise: Noise = Noise()
    rest_map: Path | None = None

    @model_validator(mode="after")
    def _complete(self) -> CameraSpec:
        if self.projection == "perspective" and self.focal_px is None:
            raise refused("focal_px", None, "two numbers above 0 for projection 'perspective'")
        if self.projection == "orthographic" and self.pixel_mm is None:
            raise refused("pixel_mm", None, "a number above 0 for projection 'orthographic'")
        dx, _, dz = (a - p for a, p in zip(self.look_at_mm, self.position_mm, strict=True))
        if dx == 0 and dz == 0:
            # v_axis is +y made perpendicular to the axis, so the axis must not lie along y
            raise refused(
                "look_at_mm", list(self.look_at_mm), "a point off the line along y through position_mm"
            )
        if self.exposure_s * self.rate_hz > 1 + 1e-6:
            raise refused("exposure_s", self.exposure_s, f"at most the frame time, {1 / self.rate_hz:.6g}")
        if self.region_px is not None and self.region_px[2:] != (self.columns, self.rows):
            size = f"{self.columns}, {self.rows} (columns, rows) at its end"
            raise refused("region_px", list(self.region_px), size)
        if self.noise.black_grey >= 2**self.bits - 1:
            raise refused("noise.black_grey", self.noise.black_grey, f"below {2**self.bits - 1}")
        return self


class TargetSpec(Table):
    """The picture that the camera is to see, in camera pixels.

    Light = mean +- contrast x mean; the period is even and a node lies every half period.
    """

    kind: Literal["cosines", "checker", "lattice", "noise"] = "cosines"
    period_px: Annotated[int, Field(ge=8, le=64, multiple_of=2)] = 16
    mean: Annotated[float, Field(gt=0, lt=1)] = 0.5
    contrast: Annotated[float, Field(gt=0, le=1)] = 0.9

    @model_validator(mode="after")
    def _displayable(self) -> TargetSpec:
        if self.mean * (1 + self.contrast) > 1 + 1e-9:
            raise refused("contrast", self.contrast, f"at most 1 / mean - 1 = {1 / self.mean - 1:.6g}")
        return self


class ControlSpec(Table):
    """The loop: who controls, and how boldly.

    `gain` 0..1: share of each correction applied at once (composition: filter's upper limit;
    integrator: its gain); `leak` is the integrator's alone, per frame. `strips` "edges": coded strips at two
    edges of the view tell which pictures a frame saw.
    """

    controller: Literal["composition", "integrator"] = "composition"
    gain: Annotated[float, Field(gt=0, le=1)] = 1.0
    leak: Annotated[float, Field(ge=0, lt=1)] = 0.01
    timeout_s: Positive = 1.0
    strips: Literal["none", "edges"] = "none"


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


class SurfaceSpec(Table):
    """Reading depth: where the rubber is known to be at rest (else the quietest region serves)."""

    known_rest: tuple[KnownRest, ...] = ()


class Faults(Table):
    """Planted faults of the simulated devices; frame numbers count from 0, None = never."""

    drop_frames: tuple[Count, ...] = ()
    repeat_frames: tuple[Count, ...] = ()
    late_frames: tuple[Count, ...] = ()
    late_s: NotNegative = 0.05
    torn_frames: tuple[Count, ...] = ()
    stall_at_frame: Count | None = None
    stall_s: NotNegative = 0.0
    camera_lost_at_frame: Count | None = None
    camera_back_after_s: NotNegative | None = None
    display_lost_at_show: Count | None = None
    light_off_frames: tuple[Count, Count] | None = None


class SimulationSpec(Table):
    """What only the simulated bench knows: its own clocks, stray light, faults.

    The reading side never looks here. Unset rates equal the rig's. `camera_phase`: start of the first
    exposure, in camera frames after time 0. `camera_latency_s`: end of exposure to frame in hand.
    `ghost_faces`, `ghost_gap`: light of the second reflections (both prism faces; pattern face and LCD
    glass across the gap) relative to the main one. `ambient`: stray light, share of full scale.
    """

    seed: Count = 0
    renderer: Literal["gpu", "numpy"] = "gpu"
    display_refresh_hz: Rate | None = None
    display_jitter_s: Lag = 0.0
    camera_rate_hz: Rate | None = None
    camera_phase: float = 0.0
    camera_jitter_s: Lag = 0.0
    camera_latency_s: Lag = 0.004
    peak_grey_share: LitShare = 0.8
    ghost_faces: Share = 0.0
    ghost_gap: Share = 0.0
    ambient: Share = 0.0
    faults: Faults = Faults()


class Rig(Table):
    """A whole bench. `press` names a packaged scenario or a press file (see `simulation.press`)."""

    schema_version: Literal[1]
    name: Text
    prism: Prism
    pattern_layers: tuple[Layer, ...] = ()
    captured_layers: tuple[Layer, ...] = ()
    display: DisplaySpec
    camera: CameraSpec
    target: TargetSpec = TargetSpec()
    control: ControlSpec = ControlSpec()
    surface: SurfaceSpec = SurfaceSpec()
    simulation: SimulationSpec = SimulationSpec()
    press: Text = "default"

    @model_validator(mode="after")
    def _periods(self) -> Rig:
        smaller = min(self.camera.columns, self.camera.rows)
        if smaller < 4 * self.target.period_px:
            raise refused(
                "target.period_px", self.target.period_px, f"at most a quarter of {smaller} camera px"
            )
        return self
