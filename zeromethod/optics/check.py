"""Check of a rig's geometry: whether the camera can look at the LCD by the mirror."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.optics.bench import Optics
from zeromethod.optics.mirror import GridHeight
from zeromethod.optics.trace import Lost
from zeromethod.rig.model import Rig

_SAMPLES = 33

_TOUCHING_MM = 1e-9
"""Rounding allowed before two touching surfaces count as intersecting."""


def check_geometry(rig: Rig) -> None:
    """Raise InputError, one line that names the rig's key, where the bench cannot work.

    Refused: a camera inside the prism or behind its captured face, a panel tilted into the slabs in front
    of it, a view that misses that face or the mirror altogether, a centre ray that does not end on the LCD, a
    height map smaller than the view. A view that lies partly off the mirror or the LCD is legal.
    """
    optics = Optics(rig)
    camera = rig.camera
    stack = sum(layer.thickness_mm for layer in rig.camera_layers)
    if not np.isfinite(optics.camera.axis @ optics.camera.u_axis):
        raise _error(
            rig, "camera.look_at_mm", camera.look_at_mm, "must not lie straight along y from position_mm"
        )
    if camera.projection == "perspective":
        outside = -float(optics.prism.captured_face.depth_below(optics.camera.position)) - stack
        if outside <= 0.0:
            allowed = "must lie outside the prism, in front of the captured face and its layers"
            raise _error(rig, "camera.position_mm", camera.position_mm, allowed)

    _check_gap(rig, optics)
    u, v = np.meshgrid(
        np.linspace(0, camera.columns - 1, _SAMPLES), np.linspace(0, camera.rows - 1, _SAMPLES)
    )
    view = optics.trace(u, v, optics.rest)
    if (view.lost == Lost.MISSES_CAPTURED_FACE).all():
        allowed = "no pixel sees the captured face; look at the mirror through it"
        raise _error(rig, "camera.look_at_mm", camera.look_at_mm, allowed)
    through = view.lost != Lost.MISSES_CAPTURED_FACE
    if (view.lost[through] == Lost.MISSES_MIRROR).all():
        allowed = (
            f"no pixel sees the mirror (x 0 to {optics.length_mm:.6g}, |y| to {rig.prism.width_mm / 2:.6g})"
        )
        raise _error(rig, "camera.look_at_mm", camera.look_at_mm, allowed)
    _check_map(rig, optics, view.point[through & (view.lost != Lost.MISSES_MIRROR)])
    _check_centre(rig, optics)


def _check_gap(rig: Rig, optics: Optics) -> None:
    """InputError for a panel that intersects, in front of the pattern face, the slabs before the last one."""
    display, face = rig.display, optics.prism.pattern_face
    column, row = np.meshgrid(
        np.linspace(-0.5, display.columns - 0.5, _SAMPLES), np.linspace(-0.5, display.rows - 0.5, _SAMPLES)
    )
    points = optics.lcd_to_world(np.stack([column, row], axis=-1))
    before = points[face.contains(points)]
    solid_mm = sum(layer.thickness_mm for layer in rig.pattern_layers[:-1])
    room_mm = -float(np.max(face.depth_below(before), initial=-np.inf)) - solid_mm
    if room_mm < -_TOUCHING_MM:
        allowed = f"the panel cuts {-room_mm:.3g} mm into the slabs before it; tilt less or widen the gap"
        raise _error(rig, "display.tilt_deg", display.tilt_deg, allowed)


def _check_map(rig: Rig, optics: Optics, points: Float) -> None:
    """InputError for a height map that does not cover all mirror points of the view."""
    if not isinstance(optics.rest, GridHeight):
        return
    for axis, (low, high) in enumerate((optics.rest.x_range_mm, optics.rest.y_range_mm)):
        first, last = points[:, axis].min(), points[:, axis].max()
        if first < low or last > high:
            name = "xy"[axis]
            allowed = f"covers {name} {low:.6g} to {high:.6g} mm, the view needs {first:.6g} to {last:.6g}"
            raise _error(rig, "prism.rest.file", rig.prism.rest.file, allowed)


def _check_centre(rig: Rig, optics: Optics) -> None:
    """InputError for a bench whose image centre does not look at a pixel of the LCD."""
    camera, display = rig.camera, rig.display
    centre = optics.trace(
        np.array([(camera.columns - 1) / 2]), np.array([(camera.rows - 1) / 2]), optics.rest
    )
    lost = Lost(int(centre.lost[0]))
    if lost in (Lost.NONE, Lost.BELOW_TIR):
        return
    if lost == Lost.OFF_DISPLAY:
        column, row = centre.q[0]
        allowed = (
            f"the centre ray ends at column {column:.0f}, row {row:.0f}, off the {display.columns} x "
            f"{display.rows} pixels"
        )
        raise _error(rig, "display.centre_mm", display.centre_mm, allowed)
    reasons = {
        Lost.MISSES_CAPTURED_FACE: ("camera.look_at_mm", camera.look_at_mm, "misses the captured face"),
        Lost.MISSES_MIRROR: ("camera.look_at_mm", camera.look_at_mm, "misses the mirror"),
        Lost.MISSES_PATTERN_FACE: (
            "camera.position_mm",
            camera.position_mm,
            "misses the pattern face after the mirror",
        ),
        Lost.NO_REFRACTION: (
            "pattern_layers",
            [layer.index for layer in rig.pattern_layers],
            "is totally reflected at the pattern face or its layers",
        ),
    }
    key, value, what = reasons[lost]
    raise _error(rig, key, value, f"the centre ray {what}; it must reach the LCD")


def _error(rig: Rig, key: str, value: object, allowed: str) -> InputError:
    return InputError(f"{rig.name}: {key}: {value}: {allowed}")
