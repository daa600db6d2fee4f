"""Flat places in a picture: where the mirror shows nothing of the target."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Mask, Single

SIDE_PX = 7


def local_deviation(picture: Single) -> tuple[Single, Single]:
    """(mean, standard deviation) over 7 x 7 px about every pixel, (rows, cols) float32."""
    window = (SIDE_PX, SIDE_PX)
    mean = cv2.boxFilter(picture, -1, window)
    square = cv2.sqrBoxFilter(picture, -1, window)
    deviation = np.sqrt(np.maximum(square - mean * mean, 0))
    return np.asarray(mean, np.float32), np.asarray(deviation, np.float32)


def flat_places(
    picture: Single, below: Single, noise: tuple[float, float], noises: float, side_px: int = SIDE_PX
) -> Mask:
    """(rows, cols) pixels with a square around of one level, and that below another.

    noise: (variance without light, variance per grey). noises: deviations of it that count as one level.
    """
    window = (side_px, side_px)
    mean: Single = np.asarray(cv2.boxFilter(picture, -1, window), np.float32)
    square: Single = np.asarray(cv2.sqrBoxFilter(picture, -1, window), np.float32)
    allowed = noises**2 * (noise[0] + noise[1] * np.maximum(mean, 0))
    return np.asarray((mean < below) & (square - mean * mean < allowed))
