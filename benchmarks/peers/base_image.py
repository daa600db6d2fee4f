"""Contact area by a base image, as software of camera-based tactile sensors has it.

The difference to a picture without contact is blurred over 64 x 64 px, everything above 0.04 of full scale
counts as contact, and an ellipse is fitted to the largest piece. Source: the contact area of PyTouch, Lambeta
et al. 2021, doi:10.1109/ICRA48506.2021.9561084.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

BLUR_PX = 64
THRESHOLD = 0.04


def contact_outline(base: NDArray[np.uint8], frame: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """(n, 2) px of the ellipse about what differs from the base image; None where nothing does."""
    difference = cv2.absdiff(frame, base).astype(np.float32) / 255
    blurred = cv2.blur(difference, (BLUR_PX, BLUR_PX))
    mask = (blurred > THRESHOLD).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    largest = max(contours, key=cv2.contourArea)
    if len(largest) < 5:
        return None
    (u, v), (width, height), degrees = cv2.fitEllipse(largest)
    turn, t = np.radians(degrees), np.linspace(0, 2 * np.pi, 200, endpoint=False)
    along, across = 0.5 * width * np.cos(t), 0.5 * height * np.sin(t)
    return np.stack(
        (u + np.cos(turn) * along - np.sin(turn) * across, v + np.sin(turn) * along + np.cos(turn) * across),
        axis=-1,
    )
