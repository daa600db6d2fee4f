"""A commented rig file from what calipers, a protractor and data sheets give."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from zeromethod.design import SampledView
from zeromethod.errors import InputError
from zeromethod.optics import check_geometry
from zeromethod.rig.load import parse_rig
from zeromethod.rig.model import Rig

_LOOK_AT_SHARE = 0.545
"""Of the mirror's length from P0: past the middle, as P0's end has no lever."""


@dataclass(frozen=True)
class Calipers:
    """What is measured by hand. Lengths in mm, angles in degrees, pixels of the camera in micrometres.

    lcd_along_mm: from P0 to the LCD's middle, along the pattern face. distance_mm: from the lens (its front
    principal plane, about the middle of a short lens) to the captured face. lens_mm: focal length.
    """

    pattern_angle_deg: float
    camera_angle_deg: float
    pattern_length_mm: float
    width_mm: float
    index: float
    gap_mm: float
    lcd_columns: int
    lcd_rows: int
    pitch_mm: float
    lcd_along_mm: float
    refresh_hz: float
    camera_columns: int
    camera_rows: int
    pixel_um: float
    lens_mm: float
    distance_mm: float
    rate_hz: float
    exposure_s: float

    @classmethod
    def of(cls, rig: Rig) -> Calipers:
        """The same of a rig that is there already, for a lens of 50 mm in front of its pixels.

        Parameters
        ----------
        rig : Rig
            The bench.

        Returns
        -------
        Calipers
            Its measures.

        Raises
        ------
        InputError
            For a rig without a perspective camera, `prism.leg_mm` and a pattern layer.
        """
        prism, display, camera = rig.prism, rig.display, rig.camera
        if camera.projection != "perspective" or prism.pattern_length_mm is None or not rig.pattern_layers:
            raise InputError(
                f"--from: {rig.name}: a rig with a perspective camera, prism.pattern_length_mm and a pattern "
                "layer"
            )
        assert camera.focal_px is not None
        away = math.dist(camera.position_mm, camera.look_at_mm)
        length = _mirror_mm(prism.pattern_length_mm, prism.pattern_angle_deg, prism.camera_angle_deg)
        inside = (length - camera.look_at_mm[0]) * math.sin(math.radians(prism.camera_angle_deg))
        distance, lens = away - inside, 50.0
        image = _image_mm(lens, _focus_mm(distance, prism.pattern_length_mm, prism.index))
        return cls(
            prism.pattern_angle_deg,
            prism.camera_angle_deg,
            prism.pattern_length_mm,
            prism.width_mm,
            prism.index,
            rig.pattern_layers[-1].thickness_mm,
            display.columns,
            display.rows,
            display.pitch_mm,
            display.centre_mm[0],
            display.refresh_hz,
            camera.columns,
            camera.rows,
            round(1e3 * image / camera.focal_px[0], 4),
            lens,
            round(distance, 3),
            camera.rate_hz,
            camera.exposure_s,
        )

    @property
    def focal_px(self) -> float:
        """Focal length in camera px, of a lens focused on the LCD's image in the mirror."""
        focus = _focus_mm(self.distance_mm, self.pattern_length_mm, self.index)
        return 1e3 * _image_mm(self.lens_mm, focus) / self.pixel_um

    @property
    def look_at_mm(self) -> float:
        """Where on the mirror (x) the camera is taken to look."""
        return round(_LOOK_AT_SHARE * self._length_mm, 1)

    @property
    def position_mm(self) -> tuple[float, float, float]:
        """The camera's place, on the captured face's normal through what it looks at."""
        beta = math.radians(self.camera_angle_deg)
        away = self.distance_mm + (self._length_mm - self.look_at_mm) * math.sin(beta)
        return self.look_at_mm + away * math.sin(beta), 0.0, -away * math.cos(beta)

    @property
    def _length_mm(self) -> float:
        return _mirror_mm(self.pattern_length_mm, self.pattern_angle_deg, self.camera_angle_deg)


def _mirror_mm(pattern_length_mm: float, pattern_deg: float, captured_deg: float) -> float:
    """Mirror's length, from the triangle with the pattern face's."""
    top = math.radians(180.0 - pattern_deg - captured_deg)
    return pattern_length_mm * math.sin(top) / math.sin(math.radians(captured_deg))


def _focus_mm(distance_mm: float, pattern_length_mm: float, index: float) -> float:
    """From the lens to the LCD's image: rubber brings it nearer."""
    return distance_mm + pattern_length_mm / index


def _image_mm(lens_mm: float, focus_mm: float) -> float:
    """From the lens to the sensor, thin lens."""
    if focus_mm <= lens_mm:
        raise InputError(
            f"--lens: {lens_mm:g} mm: shorter than the distance to what it looks at, {focus_mm:.0f} mm"
        )
    return lens_mm * focus_mm / (focus_mm - lens_mm)


def rig_text(calipers: Calipers, name: str, path: Path) -> str:
    """Text of the rig file, checked as `load_rig` and `check_geometry` would. Raises InputError.

    Parameters
    ----------
    calipers : Calipers
        What was measured.
    name : str
        Of the rig.
    path : Path
        Of the file, for its comments and for messages.

    Returns
    -------
    str
        The file, TOML with comments.
    """
    c = calipers
    x, _, z = c.position_mm
    file = shlex.quote(path.name)
    text = f"""\
# The bench "{name}", as measured by hand. Lengths in mm, angles in degrees, times in s.
#   zeromethod run --rig {file}                                    simulates it
#   zeromethod calibrate --rig {file} --display 1 --camera 0       finds what calipers cannot
# World: origin on the edge P0 where pattern face and mirror meet, x along the mirror towards the captured
# face, z out of the rubber.
schema_version = 2
name = "{name}"
scenario = "default"       # of the simulated bench

[prism]
pattern_angle_deg = {c.pattern_angle_deg!r}   # between mirror and pattern face; to 0.3 degrees
camera_angle_deg = {c.camera_angle_deg!r}  # between mirror and captured face
pattern_length_mm = {c.pattern_length_mm!r}              # length of the pattern face; to 0.05 mm
width_mm = {c.width_mm!r}            # along y
index = {c.index!r}               # of the rubber; silicone 1.40 to 1.43

# From the rubber outwards, to the LCD; add plates and bonds before this one. Last, the gap in front of the
# panel; with its glass and glue counted as air of the same effect, to 0.17 mm.
[[pattern_layers]]
index = 1.0
thickness_mm = {c.gap_mm!r}

[display]
driver = "simulated"       # --display N takes monitor N instead
columns = {c.lcd_columns}
rows = {c.lcd_rows}
pitch_mm = {c.pitch_mm!r}           # width of the lit area / columns
centre_mm = [{c.lcd_along_mm!r}, 0.0]   # panel's middle: from P0 along the pattern face, and y; to 1.2 mm
turn_deg = 0.0             # with 0, columns grow away from P0 and rows with y
mirrored = false           # `zeromethod devices --focus` says which way round the camera sees it
refresh_hz = {c.refresh_hz!r}
latency_s = 0.0            # found by calibrate
rise_s = 0.004
gamma = 2.2                # found by calibrate

[camera]
driver = "simulated"       # --camera 0, pylon, ... takes a real one instead
columns = {c.camera_columns}
rows = {c.camera_rows}
bits = 8
projection = "perspective"
# a lens of {c.lens_mm:g} mm focused on the LCD's image, pixels of {c.pixel_um:g} µm; to 1.2 %
focal_px = [{c.focal_px:.1f}, {c.focal_px:.1f}]
centre_px = [{(c.camera_columns - 1) / 2!r}, {(c.camera_rows - 1) / 2!r}]
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
# {c.distance_mm:g} mm of air in front of the captured face, on its normal; to 3 mm and 0.6 degrees
position_mm = [{x:.4f}, 0.0, {z:.4f}]
look_at_mm = [{c.look_at_mm!r}, 0.0, 0.0]
roll_deg = 0.0
rate_hz = {c.rate_hz!r}
exposure_s = {c.exposure_s!r}
psf_px = 0.7

[camera.noise]             # found by calibrate
read_grey = 2.0
electrons_per_grey = 150.0
black_grey = 4.0

[target]
kind = "cosines"
period_px = 16             # camera px
mean = 0.5
contrast = 0.9
"""
    rig = parse_rig(text, path)
    check_geometry(rig)
    SampledView(rig)  # refuses a bench of which nothing is seen
    return text
