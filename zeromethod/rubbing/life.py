"""How long spots stay in contact while they are in view."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float
from zeromethod.rubbing.spots import Spots

_NEAR_PX = 6
"""A spot has not ended where another begins so near."""
_LEAST_PX = 20
"""Size of the spots that count: smaller ones come and go with the noise."""
_LEAST_ENDED = 3


class SpotLife:
    """Mean life of spots by those that ended; of those that left or still touch the time alone counts."""

    def __init__(self) -> None:
        self._seconds, self._ended = 0.0, 0

    def add(self, before: Spots, after: Spots, way_mm: Float, seconds: float) -> None:
        """Take two frames between which the texture moved by `way_mm` (2,)."""
        origin = np.array([after.x_mm, after.y_mm])
        large = ~before.cut & (before.sizes_mm2 > _LEAST_PX * before.pitch_mm**2)
        at = np.rint((before.places_mm[large] + way_mm - origin) / after.pitch_mm).astype(int)
        rows, cols = after.cover.shape
        at = at[(at >= 0).all(axis=1) & (at[:, 0] < cols) & (at[:, 1] < rows)]
        side = np.ones((2 * _NEAR_PX + 1,) * 2, np.uint8)
        seen = cv2.erode(after.looked.view(np.uint8), side, borderValue=0)[at[:, 1], at[:, 0]] > 0
        there = cv2.dilate((after.labels > 0).view(np.uint8), side)[at[:, 1], at[:, 0]] > 0
        self._seconds += seconds * float(np.count_nonzero(seen))
        self._ended += int(np.count_nonzero(seen & ~there))

    def mean_s(self) -> tuple[float, float] | str:
        """(mean life, its standard deviation), or why it is not known."""
        if self._ended < _LEAST_ENDED:
            return f"life: fewer than {_LEAST_ENDED} spots ended in view"
        life = self._seconds / self._ended
        return life, life / float(np.sqrt(self._ended))
