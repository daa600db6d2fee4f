"""Slopes of a surface in blocks of nodes: nodes alone where something presses, larger blocks away from it.

Far from contacts slopes change little from node to node, and a block's mean says what all its nodes say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.contact.contact import Contact
from zeromethod.surface import Surface

_NEAR_MM = 1.0
"""Nodes within a contact's smaller axis and so many mm of its border stand alone; those up to twice as far
are in blocks of 2 x 2, and so on."""
_LARGEST = 8
_SUMS = 9
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)])


@dataclass(frozen=True, slots=True)
class SlopeBlocks:
    """slope (n, 2) with its variance (n, 2), means over the nodes of a block.

    at_mm: (n, 4, 2) points whose mean slope is the block's, to third order; one and the same of a node alone.
    """

    slope: Float
    variance: Float
    at_mm: Float

    @classmethod
    def of(cls, surface: Surface, contacts: Sequence[Contact]) -> SlopeBlocks:
        """All valid nodes of a surface, in blocks; those alone come first."""
        middles = np.array([(c.x_mm, c.y_mm, c.major_mm / 2, c.minor_mm + _NEAR_MM) for c in contacts])
        place = surface.x_mm[..., None], surface.y_mm[..., None]
        sums = _summed(
            np.concatenate([surface.slope, surface.sigma_slope, *place], axis=-1),
            surface.valid.copy(), middles, _LARGEST,
        )  # fmt: skip
        sums = sums[sums[:, 0] > 0]
        mean = sums[:, 1:] / sums[:, :1]
        spread = np.maximum(mean[:, 2:4] - mean[:, :2] ** 2, 0.0)
        # rounding makes no places apart of a node alone
        spread[spread < 1e-9 * mean[:, 2:4]] = 0.0
        at = mean[:, None, :2] + np.sqrt(spread)[:, None] * _CORNERS
        return cls(mean[:, 4:6], mean[:, 6:8] / sums[:, :1], at)


@numba.njit(cache=True, nogil=True)
def _summed(read: Float, valid: Mask, middles: Float, largest: int) -> Float:
    """(blocks, 9) sums over the nodes of each block, some of them without nodes.

    read: (rows, cols, 6) slopes, their standard deviations, x, y.
    Sums of weights, and of weights times x, y, x^2, y^2, slopes and variance times weight.
    middles: (contacts, 4) x, y, half size, and reach beyond it.
    """
    rows, cols = valid.shape
    starts = [0]
    side = 1
    while side <= largest:
        starts.append(starts[-1] + ((rows + side - 1) // side) * ((cols + side - 1) // side))
        side *= 2
    sums = np.zeros((starts[-1], _SUMS))
    for i in range(rows):
        for j in range(cols):
            if not (valid[i, j] and np.isfinite(read[i, j, 2] + read[i, j, 3])):
                continue
            x, y = read[i, j, 4], read[i, j, 5]
            away = np.inf
            for k in range(len(middles)):
                beyond = np.hypot(x - middles[k, 0], y - middles[k, 1]) - middles[k, 2]
                away = min(away, beyond / middles[k, 3])
            level, side = 0, 1
            while side < largest and away > side:
                level, side = level + 1, side * 2
            block = sums[starts[level] + (i // side) * ((cols + side - 1) // side) + j // side]
            weight = 2.0 / (read[i, j, 2] ** 2 + read[i, j, 3] ** 2)
            block[0] += weight
            block[1] += weight * x
            block[2] += weight * y
            block[3] += weight * x * x
            block[4] += weight * y * y
            for c in range(2):
                block[5 + c] += weight * read[i, j, c]
                block[7 + c] += weight * weight * read[i, j, 2 + c] ** 2
    return sums


def compile_ahead() -> None:
    """Have the compiled function ready before the first contact."""
    _summed(np.ones((1, 1, 6)), np.ones((1, 1), np.bool_), np.ones((1, 4)), _LARGEST)
