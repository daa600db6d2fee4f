"""Light by the rig file: where each detector looks on the mirror, and what it sees of the LEDs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.optics.prism import PrismGeometry
from zeromethod.optics.vectors import reflect

COUNT = SIDE * SIDE


@dataclass(frozen=True)
class ArrayOptics:
    """Geometry of a rig with arrays; channel k is in row k // 16 (along y), column k % 16 (along the face).

    origin_mm, direction: (256, 3) the ray that each detector looks along, from its face, into the rubber.
    led_edge_mm, led_along, led_normal: (3,) P0, and the unit vectors along the pattern face and out of it.
    first_mm: (2,) place of LED 0 on the pattern face, along it and y. blur_mm: (256,) Gaussian sigma of what
    a detector sees of one LED, the mirror being flat.
    """

    origin_mm: Float
    direction: Float
    led_edge_mm: Float
    led_along: Float
    led_normal: Float
    first_mm: Float
    pitch_mm: float
    blur_mm: Float

    @classmethod
    def of(cls, rig: LightArrayRig) -> ArrayOptics:
        """Optics of a rig."""
        prism = PrismGeometry(rig.prism)
        pattern, camera = prism.pattern_face, prism.camera_face
        steps = np.arange(SIDE) - (SIDE - 1) / 2
        across, along = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
        detectors, leds = rig.detectors, rig.leds
        u = detectors.centre_mm[0] + detectors.pitch_mm * along
        v = detectors.centre_mm[1] + detectors.pitch_mm * across
        origin = camera.edge + u[:, None] * camera.along + v[:, None] * np.array([0.0, 1.0, 0.0])
        direction = np.broadcast_to(-camera.normal, origin.shape).copy()
        first = np.array(leds.centre_mm) + leds.pitch_mm * steps[0]
        own = cls(origin, direction, pattern.edge, pattern.along, pattern.normal, first, leds.pitch_mm, u)
        there = own.mirror_mm
        path = np.linalg.norm(there - origin, axis=1)
        path += np.abs((there - pattern.edge) @ pattern.normal)
        angle = 1e-3 * detectors.acceptance_mrad * path
        blur = np.sqrt(leds.spot_mm**2 + detectors.aperture_mm**2 + angle**2)
        return replace(own, blur_mm=blur)

    @property
    def mirror_mm(self) -> Float:
        """(256, 3) where the detectors look on the mirror at rest."""
        along = -self.origin_mm[:, 2] / self.direction[:, 2]
        return self.origin_mm + along[:, None] * self.direction

    def looked_at(self, depth: Float, slope: Float, at_mm: Float | None = None) -> Float:
        """Where rays that meet the mirror at (n, 2) x, y, with this depth and slope, come from: LED pitches.

        at_mm: by default where the detectors look at rest. Returns (n, 2), 0 at LED 0.
        """
        place = self.mirror_mm[:, :2] if at_mm is None else at_mm
        point = np.stack([place[:, 0], place[:, 1], -depth], axis=1)
        normal = np.concatenate([slope, np.ones((len(slope), 1))], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        away = reflect(self.direction, normal)
        reach = -((point - self.led_edge_mm) @ self.led_normal) / (away @ self.led_normal)
        on_face = point + reach[:, None] * away - self.led_edge_mm
        return (np.stack([on_face @ self.led_along, on_face[:, 1]], axis=1) - self.first_mm) / self.pitch_mm
