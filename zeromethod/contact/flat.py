"""Flat places in a picture: where the mirror shows nothing of the target."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Single

SIDE_PX = 7


def local_deviation(picture: Single) -> tuple[Single, Single]:
    """(mean, standard deviation) over 7 x 7 px about every pixel, (rows, cols) float32."""
    window = (SIDE_PX, SIDE_PX)
    mean = cv2.boxFilter(picture, -1, window)
    square = cv2.sqrBoxFilter(picture, -1, window)
    deviation = np.sqrt(np.maximum(square - mean * mean, 0))
    return np.asarray(mean, np.float32), np.asarray(deviation, np.float32)
