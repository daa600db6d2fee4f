"""How long spots stay in contact while they are in view."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rubbing.spots import Spots

_NEAR_PX = 6
"""A spot that is missing has not ended if there is another spot within this distance."""
_LEAST_PX = 20
"""Area of the smallest spots that count, pixels: smaller ones come and go with the noise."""
_LEAST_ENDED = 3
"""Spots that must have ended for their mean life to be known."""


class SpotLife:
    """Mean time that a spot stays in contact: time that spots were seen, over the number that ended.

    Spots that left the view, or still touch, add to the time only. A spot has ended when it is missing in two
    consecutive frames.
    """

    def __init__(self) -> None:
        self._seconds, self._ended = 0.0, 0
        self._missing: Float = np.zeros((0, 2))

    def add(self, before: Spots, after: Spots, way_mm: Float, seconds: float) -> None:
        """Add two consecutive frames, between which the texture moved by `way_mm` (2,)."""
        seen, there = _looked_for(self._missing + way_mm, after)
        self._ended += int(np.count_nonzero(seen & ~there))
        large = ~before.cut & (before.sizes_mm2 > _LEAST_PX * before.pitch_mm**2)
        places = before.places_mm[large] + way_mm
        seen, there = _looked_for(places, after)
        self._seconds += seconds * float(np.count_nonzero(seen))
        self._missing = places[seen & ~there]

    def mean_s(self) -> tuple[float, float] | str:
        """(mean life, its standard deviation), s, or why it is not known."""
        if self._ended < _LEAST_ENDED:
            return f"life: fewer than {_LEAST_ENDED} spots ended in view"
        life = self._seconds / self._ended
        return life, life / float(np.sqrt(self._ended))


def _looked_for(places_mm: Float, spots: Spots) -> tuple[Mask, Mask]:
    """(n,) whether places (n, 2) are in the area looked at, and whether a spot is there."""
    at = np.rint((places_mm - np.array([spots.x_mm, spots.y_mm])) / spots.pitch_mm).astype(int)
    rows, cols = spots.cover.shape
    inside = (at >= 0).all(axis=1) & (at[:, 0] < cols) & (at[:, 1] < rows)
    row, col = np.where(inside, at[:, 1], 0), np.where(inside, at[:, 0], 0)
    side = np.ones((2 * _NEAR_PX + 1,) * 2, np.uint8)
    seen = inside & (cv2.erode(spots.looked.view(np.uint8), side, borderValue=0)[row, col] > 0)
    return np.asarray(seen), np.asarray(cv2.dilate((spots.labels > 0).view(np.uint8), side)[row, col] > 0)
