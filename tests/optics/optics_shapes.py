"""Dents and rigs that several tests use."""

from dataclasses import dataclass

import numpy as np
from small_rigs import quarter as small
from small_rigs import telecentric

from zeromethod.rig.model import Layer
from zeromethod.simulation.press import Dent, Mirror, Shape


def gaussian(peak_mm, sigma_mm, x_mm, y_mm):
    """A Gaussian dent."""
    return Mirror((Dent(Shape.GAUSSIAN, x_mm, y_mm, peak_mm, sigma_mm),))


@dataclass(frozen=True)
class Ramp:
    """A plane through (x_mm, y_mm, 0), tilted."""

    slope_x: float
    slope_y: float
    x_mm: float
    y_mm: float

    def depth(self, x, y):
        return self.slope_x * (x - self.x_mm) + self.slope_y * (y - self.y_mm)

    def slope(self, x, y):
        return np.full_like(x, self.slope_x), np.full_like(y, self.slope_y)


def perpendicular(**parts):
    """A rig whose parallel rays cross both faces at right angles, the LCD lying on the rubber itself."""
    return telecentric(pixel_mm=0.08, **parts)


def random_rig(rng):
    """A bench with everything at odds: angles, index, layers, tilt, turn, camera."""
    a, b = rng.uniform(46.0, 54.0, size=2)
    layers = tuple(
        Layer(index=rng.uniform(1.3, 1.6), thickness_mm=rng.uniform(0.1, 2.0))
        for _ in range(rng.integers(0, 4))
    )
    if rng.random() < 0.6:
        layers += (Layer(index=1.0, thickness_mm=rng.uniform(1.5, 2.5)),)
    normal = np.array([np.sin(np.radians(b)), 0.0, -np.cos(np.radians(b))])
    look = np.array([rng.uniform(36, 42), rng.uniform(-2, 2), 0.0])
    position = look + 300.0 * normal + rng.uniform(-15, 15, size=3)
    orthographic = rng.random() < 0.5
    prism = {"pattern_angle_deg": a, "camera_angle_deg": b, "index": rng.uniform(1.38, 1.5)}
    display = {"centre_mm": (28.0, rng.uniform(-3, 3)), "columns": 1500, "rows": 1500}
    display |= {"turn_deg": rng.uniform(-180, 180), "mirrored": bool(rng.random() < 0.5)}
    display["tilt_deg"] = tuple(rng.uniform(-1.0, 1.0, size=2)) if layers else (0.0, 0.0)
    camera = {"projection": "orthographic" if orthographic else "perspective", "pixel_mm": 0.08}
    camera |= {"position_mm": tuple(position), "look_at_mm": tuple(look), "roll_deg": rng.uniform(-20, 20)}
    return small(
        prism=prism | {"pattern_length_mm": None, "mirror_length_mm": 70.0},
        pattern_layers=layers,
        camera_layers=layers[:1],
        display=display,
        camera=camera | {"distortion": (-0.2, 0.1, 0.001, -0.002, 0.0)},
    )


def pixels(rig, count=24):
    """(u, v) of a lattice of pixels over the whole image."""
    camera = rig.camera
    return np.meshgrid(np.linspace(0, camera.columns - 1, count), np.linspace(0, camera.rows - 1, count))


def close(found, expected, atol):
    """Assert that arrays agree to `atol`."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)
