"""The devices as a rig file describes them: the LCD, the camera and its noise."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from zeromethod.rig.refusal import refused
from zeromethod.rig.tables import (
    Angle,
    Count,
    Lag,
    LitShare,
    NotNegative,
    Positive,
    Rate,
    Share,
    Table,
    Text,
    Vector2,
    Vector3,
)

SIMULATED = "simulated"
"""Driver of the simulated camera and display."""

Exponent = Annotated[float, Field(ge=0.2, le=5)]
Tilt = Annotated[float, Field(ge=-45, le=45)]
Focal = Annotated[float, Field(ge=1, le=1e7)]
Exposure = Annotated[float, Field(ge=1e-7, le=60)]
Delay = Annotated[float, Field(ge=-1, le=10)]


class DisplaySpec(Table):
    """The LCD: `driver` and its own options, then what the panel is and where it lies.

    The panel lies parallel to the pattern face behind all `pattern_layers`, then tilted by
    `tilt_deg` (about the face's along direction, about y) round its centre. `centre_mm`: the panel's
    centre as (distance from P0 along the pattern face, y). With `turn_deg` 0 columns grow away from
    P0 and rows with y; `turn_deg` turns columns towards rows (+90: columns grow with y);
    `mirrored` flips the columns before turning.

    Timing: the first row starts to change `latency_s` after the presentation time (by the camera's stamps:
    below zero where these come early; `latency_range_s`: where it was only bounded, from, to), the last
    `scanout_s` later (default one refresh; `scan` "down" = row 0 first); light follows a change
    exponentially, `rise_s` from 10 to 90 %. Response: light = (code/255)^gamma, or `response_light`,
    the light (0..1, rising) at equally spaced codes 0..255; where the view's angle changes it over the panel,
    raised to `response_exponent`, rows of numbers on a lattice whose corners are the panel's corner pixels,
    bilinear between. `fill_factor` = lit share of the pixel
    pitch (columns, rows); stripes "rgb" splits a pixel into three along the columns. Polarisation: angle of
    the emitted light's field to y in the panel's plane (0 = s at the mirror, 90 = p);
    None = unpolarised.
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    driver: Text = SIMULATED
    columns: Annotated[int, Field(ge=16, le=16384)]
    rows: Annotated[int, Field(ge=16, le=16384)]
    pitch_mm: Positive
    centre_mm: Vector2
    turn_deg: Angle = 0.0
    mirrored: bool = False
    tilt_deg: tuple[Tilt, Tilt] = (0.0, 0.0)
    refresh_hz: Rate
    latency_s: Delay = 0.0
    latency_range_s: tuple[Delay, Delay] | None = None
    scanout_s: Lag | None = None
    scan: Literal["down", "up"] = "down"
    rise_s: Lag = 0.0
    gamma: Annotated[float, Field(ge=0.2, le=5)] = 1.0
    response_light: tuple[Share, ...] | None = None
    response_exponent: tuple[tuple[Exponent, ...], ...] | None = None
    fill_factor: tuple[LitShare, LitShare] = (1.0, 1.0)
    stripes: Literal["none", "rgb"] = "none"
    polarisation_deg: Angle | None = None

    def __repr__(self) -> str:
        size = f"{self.columns}x{self.rows} px @ {self.refresh_hz:g} Hz"
        return f"DisplaySpec({self.driver!r}, {size}, pitch {self.pitch_mm:g} mm)"

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

    @model_validator(mode="after")
    def _within_range(self) -> DisplaySpec:
        bounds = self.latency_range_s
        if bounds is not None and not bounds[0] <= self.latency_s <= bounds[1]:
            raise refused("latency_range_s", list(bounds), f"from, to around latency_s = {self.latency_s:g}")
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
    exposed all at once (global shutter). `psf_px`: Gaussian sigma of lens and defocus, camera px. `pupil_mm`:
    diameter of the lens's entrance pupil, for perspective; the camera is focused on the LCD's image, so
    that a pixel sees the pupil's footprint of the mirror, which blurs the borders of contacts; 0: not known
    (the simulated bench: a point).

    What a real camera is set to, where its driver can: `gain` in the device's own units, `pixel_format` by
    its GenICam name, `region_px` (first column, first row, columns, rows) of the sensor, and `trigger`: runs
    "free", is fired by "software" for each frame, or by "hardware" through an input line. `latency_s`: from
    the end of an exposure until its frame is received, at the least. `reopen_s`: how long a camera that was
    lost is tried again before a run ends; one that reboots takes half a minute.

    `rest_map`: file of the LCD position that every pixel was measured to see by the mirror at rest (`.npz`
    of `zeromethod calibrate decode`, `arrays.h5` of a calibration). Readings then start from there, and each
    node has the ray that sees it so; without, both are those of the geometry.
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)

    driver: Text = SIMULATED
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
    exposure_s: Exposure
    latency_s: Lag = 0.0
    gain: NotNegative | None = None
    pixel_format: Text | None = None
    region_px: tuple[Count, Count, Count, Count] | None = None
    trigger: Literal["free", "software", "hardware"] = "free"
    psf_px: NotNegative = 0.0
    pupil_mm: NotNegative = 0.0
    noise: Noise = Noise()
    reopen_s: NotNegative = 60.0
    rest_map: Path | None = None

    def __repr__(self) -> str:
        size = f"{self.columns}x{self.rows} px @ {self.rate_hz:g} Hz"
        return f"CameraSpec({self.driver!r}, {size}, {self.bits} bits, {self.projection})"

    @model_validator(mode="after")
    def _complete(self) -> CameraSpec:
        if self.projection == "perspective" and self.focal_px is None:
            raise refused("focal_px", None, "two numbers above 0 for projection 'perspective'")
        if self.projection == "orthographic" and self.pixel_mm is None:
            raise refused("pixel_mm", None, "a number above 0 for projection 'orthographic'")
        if self.projection == "orthographic" and self.pupil_mm:
            raise refused("pupil_mm", self.pupil_mm, "0 for projection 'orthographic'")
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


class WatchSpec(CameraSpec):
    """A watch camera: two lenses side by side in one frame, which look from below through the rubber.

    The left half of the columns is the view of the left lens. `position_mm` is half-way between the lenses,
    whose axes are parallel and `baseline_mm` apart along the columns; `centre_px` is the left view's, in its
    own half; the right view's is its mirror image.
    """

    baseline_mm: Positive = 0.0

    @model_validator(mode="after")
    def _halves(self) -> WatchSpec:
        if not self.baseline_mm:
            needed = "a number above 0, from the left lens to the right one"
            raise refused(
                "baseline_mm", None, f"{needed}; by one lens it cannot be known when something touches"
            )
        if self.columns % 2:
            raise refused("columns", self.columns, "an even number: two views side by side")
        if self.projection != "perspective":
            raise refused("projection", self.projection, "'perspective' for a watch camera")
        return self

    def camera(self, **other: Any) -> CameraSpec:
        """The table of a plain camera, with other values: all of it, or one of its views."""
        keys = self.given() | (self.model_extra or {}) | other
        del keys["baseline_mm"]
        return CameraSpec.model_validate(keys)
