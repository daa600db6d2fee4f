"""Area, centroid and axes of a polygon."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float


class Moments(NamedTuple):
    """area_mm2; centroid mm; axes of the ellipse of the same second moments: whole lengths mm, degrees."""

    area_mm2: float
    x_mm: float
    y_mm: float
    major_mm: float
    minor_mm: float
    angle_deg: float


def moments(outline_mm: Float) -> Moments:
    """Moments of a closed polygon (n, 2), by Green's theorem."""
    origin = outline_mm.mean(axis=0)
    x, y = (outline_mm - origin).T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y1 - x1 * y
    area = float(cross.sum() / 2)
    cx, cy = float(((x + x1) * cross).sum() / (6 * area)), float(((y + y1) * cross).sum() / (6 * area))
    xx = float(((x * x + x * x1 + x1 * x1) * cross).sum() / (12 * area)) - cx**2
    yy = float(((y * y + y * y1 + y1 * y1) * cross).sum() / (12 * area)) - cy**2
    mixed = (x * y1 + 2 * x * y + 2 * x1 * y1 + x1 * y) * cross
    xy = float(mixed.sum() / (24 * area)) - cx * cy
    middle, half = (xx + yy) / 2, float(np.hypot((xx - yy) / 2, xy))
    angle = 0.5 * np.degrees(np.arctan2(2 * xy, xx - yy)) % 180
    major, minor = (4 * float(np.sqrt(max(value, 0.0))) for value in (middle + half, middle - half))
    return Moments(abs(area), cx + float(origin[0]), cy + float(origin[1]), major, minor, float(angle))
