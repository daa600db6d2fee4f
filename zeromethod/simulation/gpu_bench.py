"""A rig in the constants that the ray shader takes: planes, layers, camera and LCD axes.

Worked out from the rig file alone and not with `zeromethod.optics`, so that the drawn bench and the reading
side's ray model check each other.

Convention: world axes as everywhere (x along the mirror from P0 to the camera face, z out of the rubber,
y = z cross x) but counted from the middle of the mirror, mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float
from zeromethod.rig.model import CameraSpec, DisplaySpec, Prism, Rig

Values = dict[str, ArrayLike]

_Y = np.array([0.0, 1.0, 0.0])


def mirror_length_mm(prism: Prism) -> float:
    """L0: given, or leg sin(alpha0 + beta0) / sin(beta0)."""
    if prism.mirror_length_mm is not None:
        return prism.mirror_length_mm
    alpha, beta = np.radians([prism.pattern_angle_deg, prism.camera_angle_deg])
    return float((prism.pattern_length_mm or 0.0) * np.sin(alpha + beta) / np.sin(beta))


def mirror_middle_mm(prism: Prism) -> Float:
    """World position (3,) of the shader's origin."""
    return np.array([mirror_length_mm(prism) / 2, 0.0, 0.0])


@dataclass(frozen=True)
class _Face:
    """Plane of a prism face: edge on the mirror, direction to the apex, outward normal (3,), length."""

    edge: Float
    along: Float
    normal: Float
    length: float

    def values(self, name: str) -> Values:
        return {f"{name}_{key}": value for key, value in vars(self).items()}


def _faces(prism: Prism) -> tuple[_Face, _Face]:
    """(pattern face, camera face)."""
    alpha, beta = np.radians([prism.pattern_angle_deg, prism.camera_angle_deg])
    half = mirror_length_mm(prism) / 2

    if prism.teeth is not None:
        tip_mm = prism.teeth.base_mm + _height_mm(2 * half / prism.teeth.count, alpha, beta)
        along, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
        under = _Face(np.array([-half, 0.0, -tip_mm]), along, down, 2 * half)
        return under, under
    return _triangle(0.0, 0.0, half, alpha, beta)


def _height_mm(base_mm: float, alpha: float, beta: float) -> float:
    """Height of a triangle of that base and these angles next to it."""
    return float(base_mm * np.sin(alpha) * np.sin(beta) / np.sin(alpha + beta))


def _triangle(
    middle_mm: float, below_mm: float, half: float, alpha: float, beta: float
) -> tuple[_Face, _Face]:
    """(pattern face, camera face) of a triangle whose base has its middle at x = middle_mm."""

    def face(sense: float, angle: float, other: float) -> _Face:
        return _Face(
            np.array([middle_mm - sense * half, 0.0, -below_mm]),
            np.array([sense * np.cos(angle), 0.0, -np.sin(angle)]),
            np.array([-sense * np.sin(angle), 0.0, -np.cos(angle)]),
            float(2 * half * np.sin(other) / np.sin(angle + other)),
        )

    return face(1.0, alpha, beta), face(-1.0, beta, alpha)


def _tooth_values(prism: Prism) -> Values:
    """Faces of all teeth of a saw; none of a prism."""
    teeth = prism.teeth
    if teeth is None:
        return {}
    none = (0.0,) * teeth.count
    half = mirror_length_mm(prism) / teeth.count / 2
    faces = [
        _triangle(
            half * (2 * k + 1 - teeth.count), teeth.base_mm + deeper, half,
            *np.radians([prism.pattern_angle_deg + alpha, prism.camera_angle_deg + beta]),
        )
        for k, (deeper, alpha, beta) in enumerate(
            zip(
                teeth.base_deviation_mm or none,
                teeth.pattern_deviation_deg or none,
                teeth.camera_deviation_deg or none,
                strict=True,
            )
        )
    ]  # fmt: skip
    values: Values = {"tooth_lengths": np.array([[face.length for face in both] for both in faces])}
    for number, name in enumerate(("tooth_pattern", "tooth_camera")):
        for key in ("edge", "along", "normal"):
            values[f"{name}_{key}"] = np.array([getattr(both[number], key) for both in faces])
    return values


def _turned(vector: Float, axis: Float, angle_deg: float) -> Float:
    """`vector` turned right-handed about the unit vector `axis` (Rodrigues)."""
    angle = np.radians(angle_deg)
    along = axis * float(vector @ axis)
    turned: Float = along + np.cos(angle) * (vector - along) + np.sin(angle) * np.cross(axis, vector)
    return turned


def _camera_values(camera: CameraSpec, camera_face: _Face, stack_mm: float, middle: Float) -> Values:
    position = np.array(camera.position_mm) - middle
    axis = np.array(camera.look_at_mm) - middle - position
    axis /= np.linalg.norm(axis)
    v_axis = _Y - axis * axis[1]
    v_axis /= np.linalg.norm(v_axis)
    u_axis = np.cross(v_axis, axis)
    outer = camera_face.edge + stack_mm * camera_face.normal
    way = float((outer - position) @ camera_face.normal / (axis @ camera_face.normal))
    if camera.projection == "orthographic":
        scale = np.full(2, camera.pixel_mm)
    else:
        scale = 1.0 / np.array(camera.focal_px)
    # u x v = axis: a right-handed turn about it moves u towards v
    return {
        "camera_axis": axis,
        "camera_u": _turned(u_axis, axis, camera.roll_deg),
        "camera_v": _turned(v_axis, axis, camera.roll_deg),
        "camera_centre": np.array(camera.centre_px),
        "camera_scale": scale,
        "entry": position + way * axis,
        "entry_way": way,
        **dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion, strict=True)),
    }


def _display_values(display: DisplaySpec, pattern: _Face, stack_mm: float) -> Values:
    def tilted(vector: Float) -> Float:
        return _turned(_turned(vector, pattern.along, display.tilt_deg[0]), _Y, display.tilt_deg[1])

    first = -pattern.along if display.mirrored else pattern.along
    turn = np.radians(display.turn_deg)
    polarisation = np.radians(display.polarisation_deg or 0.0)
    centre = pattern.edge + display.centre_mm[0] * pattern.along + display.centre_mm[1] * _Y
    return {
        "lcd_centre": centre + stack_mm * pattern.normal,
        "lcd_column": tilted(np.cos(turn) * first + np.sin(turn) * _Y),
        "lcd_row": tilted(np.cos(turn) * _Y - np.sin(turn) * first),
        "lcd_normal": tilted(pattern.normal),
        "lcd_field": tilted(np.cos(polarisation) * _Y + np.sin(polarisation) * pattern.along),
        "lcd_middle": np.array([display.columns - 1, display.rows - 1]) / 2,
        "lcd_pitch": display.pitch_mm,
    }


def bench_values(rig: Rig) -> Values:
    """Constants of bench_rays.frag that belong to the rig."""
    prism, layers = rig.prism, rig.pattern_layers
    pattern, camera_face = _faces(prism)
    camera_stack = sum(layer.thickness_mm for layer in rig.camera_layers)
    stack = sum(layer.thickness_mm for layer in layers)
    last_mm = layers[-1].thickness_mm if layers else 0.0
    slabs = {
        "camera_layers": np.array([(s.index, s.thickness_mm) for s in rig.camera_layers], dtype=float),
        "inner_layers": np.array([(s.index, s.thickness_mm) for s in layers[:-1]], dtype=float),
    }
    return {
        **pattern.values("pattern"),
        **camera_face.values("camera_face"),
        **_tooth_values(prism),
        "half_mirror": np.array([mirror_length_mm(prism), prism.width_mm]) / 2,
        "rubber_index": prism.index,
        "camera_stack": float(camera_stack),
        "inner_stack": float(stack - last_mm),
        "last_mm": float(last_mm),
        "last_index": layers[-1].index if layers else prism.index,
        **{name: values for name, values in slabs.items() if values.size},
        **_camera_values(rig.camera, camera_face, camera_stack, mirror_middle_mm(prism)),
        **_display_values(rig.display, pattern, stack),
    }


def bench_defines(rig: Rig) -> dict[str, int]:
    """Preprocessor constants of bench_rays.frag that belong to the rig."""
    return {
        "TEETH": 0 if rig.prism.teeth is None else rig.prism.teeth.count,
        "CAMERA_LAYERS": len(rig.camera_layers),
        "INNER_LAYERS": max(len(rig.pattern_layers) - 1, 0),
        "ORTHOGRAPHIC": int(rig.camera.projection == "orthographic"),
        "DISTORTED": int(any(rig.camera.distortion)),
        "POLARISED": int(rig.display.polarisation_deg is not None),
    }
