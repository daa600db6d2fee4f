"""Noticing that the light is off, which is not the same as a press that hides the mirror."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Mask

OFF_BELOW = 0.25
"""Share of the usual light under which it counts as off."""

MEMORY = 0.05
"""Share of every good frame in the usual light."""


class LightWatch:
    """Follows the mean grey of the nodes seen at rest; what presses changes it little and slowly."""

    def __init__(self, seen: Mask, black_grey: float) -> None:
        self._seen = seen
        self._black = black_grey
        self._usual: float | None = None

    def is_off(self, mean_grey: NDArray[np.floating]) -> bool:
        """Whether a frame with these means per node, (rows, cols) grey, was taken without light."""
        if not self._seen.any():
            return False
        light = float(mean_grey.mean(where=self._seen)) - self._black
        if self._usual is None:
            self._usual = light
        off = not light > OFF_BELOW * self._usual
        if not off:
            self._usual += MEMORY * (light - self._usual)
        return off
