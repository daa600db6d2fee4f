"""Benches whose figures are known in closed form."""

import numpy as np
from small_rigs import quarter as small

from zeromethod.design import SampledView
from zeromethod.rig.model import Layer, Rig

PIXEL_MM = 0.1
PUPIL_AWAY_MM = 150.0
PLATE = Layer(index=1.5, thickness_mm=2.0)
GAP = Layer(index=1.0, thickness_mm=0.5)


def telecentric(angle_deg=50.0, layers=(), pixel_mm=PIXEL_MM, **parts) -> Rig:
    """A symmetric prism, parallel rays at right angles to both faces: incidence = the prism's angle."""
    angle = np.radians(angle_deg)
    mirror_mm = 2 * 60.0 * np.cos(angle)
    look = np.array([mirror_mm / 2, 0.0, 0.0])
    position = look + PUPIL_AWAY_MM * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    camera = {
        "projection": "orthographic",
        "pixel_mm": pixel_mm,
        "focal_px": None,
        "position_mm": tuple(position),
        "look_at_mm": tuple(look),
    } | parts.pop("camera", {})
    prism = {"pattern_angle_deg": angle_deg, "camera_angle_deg": angle_deg} | parts.pop("prism", {})
    return small(camera=camera, prism=prism, pattern_layers=tuple(layers), **parts)


def at_centre(view: SampledView, values: np.ndarray) -> np.ndarray:
    """Values (rows, cols, ...) of the middle node."""
    return values[values.shape[0] // 2, values.shape[1] // 2]
