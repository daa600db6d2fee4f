"""What drivers give, checked where it is taken over: a driver's mistake is named there, not met later."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import DTypeLike


def presentation_ns(given: object) -> int:
    """Time, ns, that a display's `show` gave. Raises TypeError where that is none."""
    if isinstance(given, int | np.integer):
        return int(given)
    if not isinstance(given, float | np.floating) or not math.isfinite(given):
        raise TypeError(f"show() gave {given!r}, not the presentation time in ns")
    return round(float(given))


def wrong_image(image: object, shape: tuple[int, int], dtype: DTypeLike) -> str:
    """Why an image is not what the camera said it gives, in words; "" where it is."""
    if isinstance(image, np.ndarray) and image.shape == shape and image.dtype == dtype:
        return ""
    found = f"{getattr(image, 'shape', '')} {getattr(image, 'dtype', type(image).__name__)}"
    return f"the frame is {found}, not {shape} {np.dtype(dtype)}"
