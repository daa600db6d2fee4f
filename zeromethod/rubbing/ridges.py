"""Ridges or rows of a texture: their distance, and the direction across them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from zeromethod.contact.stripes import refined, strongest, wave
from zeromethod.rubbing.spots import Spots

_REGULAR, _BY_CHANCE = 0.03, 1.0
"""A texture is regular if one wave has at least this share of the spectrum's power, and at least the second
number over the number of spots: spots at random may have that much by chance. (Share times number: pile and
grains 0.6, square arrays of 20 spots 1.7 and more.)"""
_STRAY, _SCALE = 0.1, 0.005
"""Relative standard deviations of a pitch. By spots that lie off their rows: in periods, of one spot. By the
scale of the image, which depends on the mirror's depth, interpolated inside a contact."""
_AS_STRONG = 0.5
"""The direction of the frame before is kept while its wave has this share of the strongest one's power."""


class Ridges(NamedTuple):
    """pitch_mm, angle_deg (across the ridges, from x towards y, 0 to 180), with standard deviations."""

    pitch_mm: float
    sigma_mm: float
    angle_deg: float
    sigma_deg: float


def ridges_of(spots: Spots, before: Ridges | None = None) -> Ridges | str:
    """The most regular rows of the spots, or why there are none.

    before: those of the frame before. Of two directions that are about as strong, as in a square array, the
    same one is kept.
    """
    away = cv2.distanceTransform(np.pad(spots.looked.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    weight = np.sqrt(away / away.max())
    light = weight * (spots.cover - float((weight * spots.cover).sum() / weight.sum()))
    start = strongest(light)
    if start is None:
        return "pitch: fewer than three periods in view"
    light[~spots.looked] = 0
    if before is not None:
        turn = np.radians(before.angle_deg)
        same = spots.pitch_mm / before.pitch_mm * np.array([np.cos(turn), np.sin(turn)])
        if wave(light, same) ** 2 > _AS_STRONG * wave(light, start) ** 2:
            start = same
    cycles = refined(light, start)
    per_mm = float(np.hypot(*cycles)) / spots.pitch_mm
    count = len(spots.sizes_mm2)
    regular = wave(light, cycles) ** 2 / (np.count_nonzero(spots.looked) * float((light**2).sum()))
    if regular < max(_REGULAR, _BY_CHANCE / count):
        return "pitch: nothing regular"
    strays = _STRAY / (per_mm * np.sqrt(spots.looked_mm2 * count))
    sigma = float(np.hypot(strays, _SCALE))
    angle = float(np.degrees(np.arctan2(cycles[1], cycles[0])) % 180)
    return Ridges(1 / per_mm, sigma / per_mm, angle, float(np.degrees(sigma)))
