"""Benches whose figures are known in closed form."""

import numpy as np
from small_rigs import quarter as small
from small_rigs import telecentric

from zeromethod.design import SampledView
from zeromethod.rig.model import Layer

__all__ = ["GAP", "PIXEL_MM", "PLATE", "PUPIL_AWAY_MM", "at_centre", "small", "telecentric"]

PIXEL_MM = 0.1
PUPIL_AWAY_MM = 150.0
PLATE = Layer(index=1.5, thickness_mm=2.0)
GAP = Layer(index=1.0, thickness_mm=0.5)


def at_centre(view: SampledView, values: np.ndarray) -> np.ndarray:
    """Values (rows, cols, ...) of the middle node."""
    return values[values.shape[0] // 2, values.shape[1] // 2]
