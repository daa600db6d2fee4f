"""Area, centroid and axes of a polygon."""

from __future__ import annotations

import math
from typing import NamedTuple

from zeromethod.arrays import Float
from zeromethod.contact.polygon import second_moments


class Moments(NamedTuple):
    """area_mm2; centroid mm; axes of the ellipse of the same second moments: whole lengths mm, degrees."""

    area_mm2: float
    x_mm: float
    y_mm: float
    major_mm: float
    minor_mm: float
    angle_deg: float


def moments(outline_mm: Float) -> Moments:
    """Moments of a closed polygon (n, 2)."""
    area, x, y, xx, yy, xy = second_moments(outline_mm)
    middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    angle = 0.5 * math.degrees(math.atan2(2 * xy, xx - yy)) % 180
    major, minor = (4 * math.sqrt(max(value, 0.0)) for value in (middle + half, middle - half))
    return Moments(abs(area), x, y, major, minor, angle)
