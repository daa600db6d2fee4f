"""A fine surface as viewers are shown it: with no more pixels than their screens have for it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Single
from zeromethod.fine.surface import FineSurface

MOST_COLUMNS = 640
"""A finer map is made coarser: a panel has fewer pixels of the screen."""


class FineMaps:
    """Maps of one fine surface, made when they are first looked at.

    surface: what is shown. time_s: of its newest frame, s of the run. step: number of the step that brought
    it. image: (columns, rows) of the camera.
    """

    def __init__(self, surface: FineSurface, time_s: float | None, step: int, image: list[int]) -> None:
        self._surface, self._time_s, self._step, self._image = surface, time_s, step, image

    @cached_property
    def part(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Depth and its sigma, mm, NaN where a square was not read whole; and what is said of them."""
        surface = self._surface
        size = -(-surface.depth_mm.shape[1] // MOST_COLUMNS)
        depth, sigma = (reduced(one, size) for one in (surface.depth_mm, surface.sigma_depth_mm))
        known = np.isfinite(depth)
        row, column = np.unravel_index(int(np.argmax(np.where(known, np.abs(depth), -1.0))), depth.shape)
        first = [surface.first_px[axis] + (size - 1) / 2 for axis in (1, 0)]
        meta = {
            "step": self._step,
            "time_s": self._time_s,
            "lattice": {"first": first, "spacing": size, "image": self._image},
            "peak_node": [int(column), int(row)] if known.any() else None,
        }
        return {"depth": depth, "sigma": sigma}, meta


def reduced(values: Single, size: int) -> Single:
    """Means of squares of size x size; what does not fill one at the far ends is left out."""
    if size == 1:
        return values
    rows, columns = (one // size for one in values.shape)
    whole = values[: rows * size, : columns * size]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
