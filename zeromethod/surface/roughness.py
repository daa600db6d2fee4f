"""Roughness of what was read: how much more than its noise slopes change from node to node, compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Mask

_ROWS = 3
"""Every so many rows of nodes are looked at: more say little new."""
_MEDIAN = 0.4549
"""Median of the square of a normal variable of variance 1."""
_CERTAIN = 1.3
"""Ratio that is no more than chance among hundreds of nodes that share noise."""
_WEIGHTS = 70.0, -112.0, 56.0, -16.0, 2.0
"""Of noise 0 to 4 nodes apart in the square of a fourth difference."""


@numba.njit(cache=True, error_model="numpy")
def roughness(slope: Float, variance: Float, correlation: Float, island: Mask) -> float:
    """Variance of slopes (rows, cols, 2) from node to node over the stated, (rows, cols, 2), at least 1.

    By fourth differences along rows, of which smooth dents have none but at narrow ones: their median.
    correlation: of noise 0, 1, 2, ... nodes apart.
    """
    expected = 0.0
    for k in range(min(len(correlation), len(_WEIGHTS))):
        expected += _WEIGHTS[k] * correlation[k]
    rows, cols = island.shape
    ratio, count, over = np.empty(2 * (rows // _ROWS + 1) * cols), 0, 0
    for i in range(0, rows, _ROWS):
        for j in range(2, cols - 2):
            if (
                island[i, j - 2]
                and island[i, j - 1]
                and island[i, j]
                and island[i, j + 1]
                and island[i, j + 2]
            ):
                for k in range(2):
                    beside = slope[i, j - 1, k] + slope[i, j + 1, k]
                    bend = slope[i, j - 2, k] + slope[i, j + 2, k] - 4.0 * beside + 6.0 * slope[i, j, k]
                    ratio[count] = bend * bend / (expected * variance[i, j, k])
                    over += not ratio[count] <= _CERTAIN * _MEDIAN
                    count += 1
    # most often there is no need to look for the median
    if 2 * over < count or count == 0:
        return 1.0
    found = float(np.median(ratio[:count])) / _MEDIAN
    return found if found > _CERTAIN else 1.0
