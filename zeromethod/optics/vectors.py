"""Small vector helpers shared by the ray model: arrays whose last axis holds (x, y, z)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def dot(a: Array, b: Array) -> Array:
    """Scalar product along the last axis: (..., 3), (..., 3) -> (...)."""
    product: Array = np.einsum("...i,...i->...", a, b)
    return product


def unit(vector: Array) -> Array:
    """Vector (..., 3) divided by its length."""
    length: Array = np.sqrt(dot(vector, vector))
    result: Array = vector / length[..., None]
    return result
