"""Result of tracing a camera pixel's ray."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Bytes, Float, Mask


class Lost(enum.IntEnum):
    """Reason why a ray is lost: the first on the way from the camera, except for BELOW_TIR.

    BELOW_TIR is given only where the ray otherwise ends on a pixel of the LCD: light still returns, but
    dimmer.
    """

    NONE = 0
    MISSES_CAMERA_FACE = 1
    MISSES_MIRROR = 2
    MISSES_PATTERN_FACE = 3
    NO_REFRACTION = 4  # totally reflected at the pattern face or in its layers
    OFF_DISPLAY = 5  # ends outside the LCD's pixels (q still given, unless its plane is not met)
    BELOW_TIR = 6  # the mirror reflects only partially (q given, reflectance < 1)
    SEAM = 7  # a face of this tooth or the next is in the way (q given as if it were not)


@dataclass(frozen=True, slots=True)
class Trace:
    """Rays from camera pixels to the LCD; every field has the pixels' shape in front.

    q: (..., 2) LCD (column, row) in px; NaN where lost before the LCD's plane.
    point: (..., 3) where the ray meets the mirror's surface, mm; NaN where it meets none.
    cos_incidence: (...) cosine of the angle of incidence on the mirror.
    reflectance: (...) of the mirror for the LCD's polarisation, 0 to 1.
    path_mm: (...) geometric length from mirror to LCD.
    lost: (...) uint8 of `Lost`.
    """

    q: Float
    point: Float
    cos_incidence: Float
    reflectance: Float
    path_mm: Float
    lost: Bytes

    @property
    def reaches_display(self) -> Mask:
        """(...) whether the ray ends on a pixel of the LCD, dimmed or not."""
        return np.asarray((self.lost == Lost.NONE) | (self.lost == Lost.BELOW_TIR))
