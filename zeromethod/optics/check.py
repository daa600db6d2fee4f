"""Check of a rig's geometry: whether the camera can look at the LCD by the mirror."""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.optics.bench import Optics
from zeromethod.optics.mirror import GridHeight
from zeromethod.optics.trace import Lost
from zeromethod.optics.vectors import dot
from zeromethod.rig.model import Rig

_SAMPLES = 33
"""Pixels along each axis of the view, and of the panel, that are checked."""

_TOUCHING_MM = 1e-9
"""Rounding allowed before two touching surfaces count as intersecting."""

_CENTRE_LOST = {
    Lost.MISSES_CAMERA_FACE: ("camera.look_at_mm", "misses the camera face"),
    Lost.MISSES_MIRROR: ("camera.look_at_mm", "misses the mirror"),
    Lost.MISSES_PATTERN_FACE: ("camera.position_mm", "misses the pattern face after the mirror"),
    Lost.NO_REFRACTION: ("pattern_layers", "is totally reflected at the pattern face or its layers"),
}
"""Key to blame, and what happened to the ray of the image's centre."""


def check_geometry(rig: Rig) -> None:
    """Raise InputError, one line that names the rig's key, where the bench cannot work.

    Refused: a camera inside the prism or behind its camera face, an LCD in a camera's view of a saw, a panel
    tilted into the slabs in front of it, a view that misses that face or the mirror altogether, a centre ray
    that does not end on the LCD, a height map smaller than the view. A view that lies partly off the mirror
    or the LCD is legal.
    """
    optics, camera = Optics(rig), rig.camera
    if camera.projection == "perspective":
        stack = sum(layer.thickness_mm for layer in rig.camera_layers)
        if -float(optics.prism.camera_face.depth_below(optics.camera.position)) <= stack:
            allowed = "must lie outside the prism, in front of the camera face and its layers"
            raise _error(rig, "camera.position_mm", allowed)

    _check_gap(rig, optics)
    if rig.prism.teeth is not None:
        _check_free_view(rig, optics)
    u, v = np.meshgrid(
        np.linspace(0, camera.columns - 1, _SAMPLES), np.linspace(0, camera.rows - 1, _SAMPLES)
    )
    view = optics.trace(u, v, optics.rest)
    through = view.lost != Lost.MISSES_CAMERA_FACE
    if not through.any():
        allowed = "no pixel sees the camera face; look at the mirror through it"
        raise _error(rig, "camera.look_at_mm", allowed)
    met = through & (view.lost != Lost.MISSES_MIRROR)
    if not met.any():
        extent = f"x 0 to {optics.length_mm:.6g}, |y| to {rig.prism.width_mm / 2:.6g}"
        raise _error(rig, "camera.look_at_mm", f"no pixel sees the mirror ({extent})")
    _check_map(rig, optics, view.point[met])
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
        raise _error(rig, "display.tilt_deg", allowed)


def _check_free_view(rig: Rig, optics: Optics) -> None:
    """InputError for an LCD under a saw that stands between it and the camera."""
    u, v = np.meshgrid(*(np.linspace(0, n - 1, _SAMPLES) for n in (rig.camera.columns, rig.camera.rows)))
    origin, direction = optics.camera_rays(u, v)
    panel = optics.panel
    way = dot(panel.centre - origin, panel.normal) / dot(direction, panel.normal)
    if panel.contains(panel.world_to_lcd(origin + way[..., None] * direction))[way > 0.0].any():
        allowed = "the LCD stands in the camera's view of the teeth; move it towards P0, or the camera off"
        raise _error(rig, "display.centre_mm", allowed)


def _check_map(rig: Rig, optics: Optics, points: Float) -> None:
    """InputError for a height map that does not cover all mirror points of the view."""
    if not isinstance(optics.rest, GridHeight):
        return
    for axis, (low, high) in enumerate((optics.rest.x_range_mm, optics.rest.y_range_mm)):
        first, last = points[:, axis].min(), points[:, axis].max()
        if first < low or last > high:
            name = "xy"[axis]
            allowed = f"covers {name} {low:.6g} to {high:.6g} mm, the view needs {first:.6g} to {last:.6g}"
            raise _error(rig, "prism.rest.file", allowed)


def _check_centre(rig: Rig, optics: Optics) -> None:
    """InputError for a bench whose image centre does not look at a pixel of the LCD."""
    centre, display = optics.centre(), rig.display
    lost = Lost(int(centre.lost[0]))
    if lost == Lost.OFF_DISPLAY:
        column, row = centre.q[0]
        end = f"the centre ray ends at column {column:.0f}, row {row:.0f}"
        raise _error(rig, "display.centre_mm", f"{end}, off the {display.columns} x {display.rows} pixels")
    if lost in _CENTRE_LOST:
        key, what = _CENTRE_LOST[lost]
        raise _error(rig, key, f"the centre ray {what}; it must reach the LCD")


def _error(rig: Rig, key: str, allowed: str) -> InputError:
    return InputError(f"{rig.name}: {key}: {attrgetter(key)(rig)}: {allowed}")
