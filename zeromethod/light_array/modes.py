"""The surfaces that depth is a sum of: sines within the frame, 0 along its border, longest waves first.

In a mirror full of dents of sigma w, the variance of a sine of wave number k falls as exp(-k^2 w^2). Each
coefficient is in units of that standard deviation, so that its prior standard deviation is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.rig import LightArrayRig

_MOST = 64
"""Most half waves along each side of the frame."""


@dataclass(frozen=True)
class Modes:
    """Modes of depth.

    corner_mm: (2,) corner of the frame. wave: (2, modes) wave numbers along x and y, rad/mm. size_mm:
    (modes,) prior standard deviation of each.
    """

    corner_mm: Float
    wave: Float
    size_mm: Float

    @classmethod
    def of(cls, rig: LightArrayRig, count: int | None = None) -> Modes:
        """Modes of a rig: `count` of them, by default as many as it asks for."""
        (x0, x1), (y0, y1) = rig.frame.x_mm, rig.frame.y_mm
        side = np.array([x1 - x0, y1 - y0])
        halves = np.stack([part.ravel() for part in np.meshgrid(*2 * [np.arange(1, _MOST + 1)])])
        wave = np.pi * halves / side[:, None]
        square = np.sum(wave**2, axis=0)
        first = np.argsort(square, kind="stable")[: count or rig.reading.modes]
        width, depth = rig.reading.dent_mm, rig.reading.depth_mm
        # the depths of all modes together are `depth` rms
        size = 4 * depth * width * np.sqrt(np.pi / np.prod(side)) * np.exp(-square[first] * width**2 / 2)
        return cls(np.array([x0, y0]), wave[:, first], size)

    def derivatives(self, points_mm: Float) -> Float:
        """(6, n, modes): depth, d/dx, d/dy, d2/dx2, d2/dxdy, d2/dy2, in mm."""
        x, y = ((points_mm[:, k, None] - self.corner_mm[k]) * self.wave[k] for k in (0, 1))
        (kx, ky), sx, cx, sy, cy = self.wave, np.sin(x), np.cos(x), np.sin(y), np.cos(y)
        parts = [sx * sy, kx * cx * sy, ky * sx * cy]
        parts += [-kx * kx * parts[0], kx * ky * cx * cy, -ky * ky * parts[0]]
        return np.ascontiguousarray(self.size_mm * np.array(parts))
