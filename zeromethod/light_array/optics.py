"""Light by the rig file: where each detector looks on the mirror, and how blurred it sees the LEDs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.optics.prism import PrismGeometry

COUNT = SIDE * SIDE


class ArrayOptics(NamedTuple):
    """Geometry of a rig with arrays; channel k is in row k // 16 (along y), column k % 16 (along the face).

    mirror_mm: (256, 3) where the detectors look on the mirror at rest. direction: (3,) in which they all
    look, from the camera face into the rubber. led_face: (3, 3) P0 in mm, and the unit vectors along the
    pattern face and out of it. first_mm: (2,) place of LED 0 on that face, along it and y. blur: (256,)
    Gaussian sigma, in LED pitches, of what a detector sees of one LED in a flat mirror.
    """

    mirror_mm: Float
    direction: Float
    led_face: Float
    first_mm: Float
    pitch_mm: float
    blur: Float

    @classmethod
    def of(cls, rig: LightArrayRig) -> ArrayOptics:
        """Optics of a rig."""
        prism, detectors, leds = PrismGeometry(rig.prism), rig.detectors, rig.leds
        pattern, camera = prism.pattern_face, prism.camera_face
        steps = np.arange(SIDE) - (SIDE - 1) / 2
        across, along = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
        u = detectors.centre_mm[0] + detectors.pitch_mm * along
        v = detectors.centre_mm[1] + detectors.pitch_mm * across
        origin = camera.edge + u[:, None] * camera.along + v[:, None] * np.array([0.0, 1.0, 0.0])
        direction = -camera.normal
        mirror = origin - (origin[:, 2] / direction[2])[:, None] * direction
        path = np.linalg.norm(mirror - origin, axis=1) + np.abs((mirror - pattern.edge) @ pattern.normal)
        angle = 1e-3 * detectors.acceptance_mrad * path
        blur = np.sqrt(leds.spot_mm**2 + detectors.aperture_mm**2 + angle**2) / leds.pitch_mm
        face = np.array([pattern.edge, pattern.along, pattern.normal])
        first = np.array(leds.centre_mm) + leds.pitch_mm * steps[0]
        return cls(mirror, direction, face, first, leds.pitch_mm, blur)
