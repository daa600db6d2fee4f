"""Flat places in a picture: where the mirror shows nothing of the target."""

from __future__ import annotations

import cv2
import numba
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
    return np.asarray(_flat(mean, square, below, noises**2 * noise[0], noises**2 * noise[1]))


@numba.njit(cache=True, nogil=True)
def _flat(mean: Single, square: Single, below: Single, dark: float, per_grey: float) -> Mask:
    result = np.empty(mean.shape, np.bool_)
    for i in range(mean.shape[0]):
        for j in range(mean.shape[1]):
            level = mean[i, j]
            allowed = dark + per_grey * max(level, np.float32(0))
            result[i, j] = level < below[i, j] and square[i, j] - level * level < allowed
    return result


def compile_ahead() -> None:
    """Have the compiled function ready before the first contact."""
    flat_places(np.zeros((2, 2), np.float32), np.ones((2, 2), np.float32), (1.0, 1.0), 1.0)
