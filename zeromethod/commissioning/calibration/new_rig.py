"""A commented rig file from what calipers, a protractor and data sheets give."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, field
from pathlib import Path

import tomlkit

from zeromethod.design import SampledView
from zeromethod.errors import InputError
from zeromethod.optics import Optics, check_geometry
from zeromethod.resources import resource
from zeromethod.rig.keys import plain
from zeromethod.rig.load import parse_rig
from zeromethod.rig.model import PriorSpec, Rig, Rubber
from zeromethod.warp.rest import Rest

_LOOK_AT_SHARE = 0.545
"""Of the mirror's length from P0, unless it is known better."""


@dataclass(frozen=True)
class Calipers:
    """What is measured by hand. Lengths in mm, angles in degrees, pixels of the camera in micrometres.

    lcd_along_mm: from P0 to the LCD's middle, along the pattern face. distance_mm: from the lens (its front
    principal plane, about the middle of a short lens) to the camera face. lens_mm: focal length. aim_mm:
    where the camera looks, (x from P0 along the mirror, y); None: past the middle, as P0's end has no lever.
    priors: how well all of this is known. rubber: what holds it.
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
    aim_mm: tuple[float, float] | None = None
    rise_s: float = 0.004
    scanout_s: float | None = None
    priors: PriorSpec = field(default_factory=PriorSpec)
    rubber: Rubber = field(default_factory=Rubber)

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
        own = (
            (prism, ("pattern_angle_deg", "camera_angle_deg", "pattern_length_mm", "width_mm", "index")),
            (display, ("pitch_mm", "refresh_hz", "rise_s", "scanout_s")),
            (camera, ("rate_hz", "exposure_s")),
        )
        return cls(
            **{name: getattr(table, name) for table, names in own for name in names},
            gap_mm=rig.pattern_layers[-1].thickness_mm,
            lcd_columns=display.columns,
            lcd_rows=display.rows,
            lcd_along_mm=display.centre_mm[0],
            camera_columns=camera.columns,
            camera_rows=camera.rows,
            pixel_um=round(1e3 * image / camera.focal_px[0], 4),
            lens_mm=lens,
            distance_mm=round(distance, 3),
            priors=rig.priors,
            rubber=rig.rubber,
        )

    @property
    def focal_px(self) -> float:
        """Focal length in camera px, of a lens focused on the LCD's image in the mirror."""
        focus = _focus_mm(self.distance_mm, self.pattern_length_mm, self.index)
        return 1e3 * _image_mm(self.lens_mm, focus) / self.pixel_um

    @property
    def look_at_mm(self) -> tuple[float, float]:
        """Where on the mirror (x, y) the camera is taken to look."""
        return self.aim_mm or (round(_LOOK_AT_SHARE * self._length_mm, 1), 0.0)

    @property
    def position_mm(self) -> tuple[float, float, float]:
        """The camera's place, on the camera face's normal through what it looks at."""
        beta = math.radians(self.camera_angle_deg)
        x_mm, y_mm = self.look_at_mm
        away = self.distance_mm + (self._length_mm - x_mm) * math.sin(beta)
        return x_mm + away * math.sin(beta), y_mm, -away * math.cos(beta)

    @property
    def _length_mm(self) -> float:
        return _mirror_mm(self.pattern_length_mm, self.pattern_angle_deg, self.camera_angle_deg)


def _mirror_mm(pattern_length_mm: float, pattern_deg: float, camera_deg: float) -> float:
    """Mirror's length, from the triangle with the pattern face's."""
    top = math.radians(180.0 - pattern_deg - camera_deg)
    return pattern_length_mm * math.sin(top) / math.sin(math.radians(camera_deg))


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
    template = resource("calibration", "new_rig.toml").read_text(encoding="utf-8")
    centre_px = [(count - 1) / 2 for count in (calipers.camera_columns, calipers.camera_rows)]
    scanout = "" if calipers.scanout_s is None else f"scanout_s = {calipers.scanout_s!r}\n"
    rubber = tomlkit.dumps({"rubber": plain(calipers.rubber)})
    text = template.format(
        c=calipers,
        name=name,
        file=shlex.quote(path.name),
        centre_px=centre_px,
        scanout=scanout,
        rubber=rubber,
    )
    rig = parse_rig(text, path)
    check_geometry(rig)
    SampledView(rig)  # refuses a bench of which nothing is seen
    Rest.of(rig, Optics(rig))  # or nothing that can be drawn
    return text
