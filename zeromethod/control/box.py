"""Sums and means over square neighbourhoods of nodes; the cost does not depend on their size."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from zeromethod.arrays import Float


def box_sum(field: Float, radius: int) -> Float:
    """Sum of `field` (rows, cols) over the (2 radius + 1)^2 nodes around each; nothing beyond the edge."""
    side = 2 * radius + 1
    total = cv2.boxFilter(field, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(total, np.float64)


def box_mean(field: Float, radius: int) -> Float:
    """Mean of `field` (rows, cols) over the nodes among the (2 radius + 1)^2 around each."""
    return box_sum(field, radius) / _nodes(field.shape, radius)


@lru_cache(maxsize=4)
def _nodes(shape: tuple[int, int], radius: int) -> Float:
    """How many nodes (rows, cols) there are within a box around each."""
    return box_sum(np.ones(shape), radius)
