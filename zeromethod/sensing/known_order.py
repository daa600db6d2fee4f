"""Unwrapping where nothing is to be unwrapped: near the null, with dark places and what they cut off.

All nodes are near where they are expected, so that no edge jumps and order 0 is right wherever an order can
be known at all. What is left is to flag the few nodes that are cut off from all of which something is known.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Flags, Float
from zeromethod.warp.grid import PADDING
from zeromethod.warp.validity import Flag

AMBIGUOUS = int(Flag.AMBIGUOUS)
_OUTSIDE = int(Flag.OUTSIDE)
STEEPEST = 0.9
"""Edges steeper than this share of half a period (noise included) give no order."""
AS_GUESSED = 0.25
"""Largest difference, periods but for whole ones, of an edge's step from the guess's: wrong only where
neighbours moved apart by three quarters of a period since."""
BORDER_SHARE = 0.25
"""Least share of all border nodes in a region for them to determine its order."""
FEW = 64
"""Nodes of a region that are looked through for one with a guess."""

Ints = NDArray[np.int32]


@numba.njit(cache=True)
def is_near_null(d: Float, flags: Flags, period: float) -> bool:
    """Whether all nodes are within a quarter period (no edge jumps) and holes too few to cut off a region."""
    holes, limit = 0, period / 4
    for row in range(PADDING, d.shape[0] - PADDING):
        far = 0
        for col in range(PADDING, d.shape[1] - PADDING):
            good = flags[row, col] == 0
            # nodes covered by coded strips are whole edges of the view, which cut nothing off
            holes += not good and not (flags[row, col] & _OUTSIDE)
            far += good and max(abs(d[row, col, 0]), abs(d[row, col, 1])) > limit
        if far > 0 or holes > 3:
            return False
    return True


@numba.njit(cache=True)
def _reaches_guess(
    seed: int,
    d: Float,
    sigma: Float,
    flags: Flags,
    guess: Float,
    period: float,
    path: Ints,
    label: Ints,
    begin: int,
) -> tuple[bool, int]:
    """(Whether edges that give order lead from a node to one with a guess, end in `path` of its region).

    label: 1 for nodes on the path, 2 for those known to reach a guess. No edge jumps. The region begins at
    `begin`; as many nodes as `FEW` are taken not to reach any.
    """
    cols = label.shape[1]
    scale, highest, end = 508.0 / period, int(STEEPEST * 254), begin + 1
    path[begin], label[seed // cols, seed % cols] = seed, 1
    at = begin
    while at < end and end - begin < FEW:
        row, col = path[at] // cols + PADDING, path[at] % cols + PADDING
        at += 1
        for way in range(4):
            b, a = row + (way == 1) - (way == 3), col + (way == 0) - (way == 2)
            if flags[b, a] != 0 or label[b - PADDING, a - PADDING] == 1:
                continue
            steep = 0.0
            for k in range(2):
                steep = max(steep, abs(d[b, a, k] - d[row, col, k]) + (sigma[b, a, k] + sigma[row, col, k]))
            if int(steep * scale) > highest:
                continue
            if label[b - PADDING, a - PADDING] == 2 or math.isfinite(guess[b, a, 0] + guess[b, a, 1]):
                for node in path[begin:end]:
                    label[node // cols, node % cols] = 2
                return True, end
            path[end], label[b - PADDING, a - PADDING] = (b - PADDING) * cols + a - PADDING, 1
            end += 1
    return False, end


@numba.njit(cache=True)
def settle_known_order(
    d: Float, sigma: Float, flags: Flags, guess: Float, period: float, path: Ints, label: Ints
) -> bool:
    """Do what unwrapping does where all nodes are within a quarter period of 0 and of what is expected.

    No edge jumps then, and order 0 is right in all regions with a guess. A few nodes may have none and not be
    joined to any that has: they stay ambiguous. False, and nothing is done, for any other residual.
    """
    rows, cols, limit = d.shape[0], d.shape[1], period / 4
    label[:] = 0
    border = cut_off = 0
    for row in range(PADDING, rows - PADDING):
        for col in range(PADDING, cols - PADDING):
            if flags[row, col] != 0:
                continue
            for k in range(2):
                far = abs(d[row, col, k] - guess[row, col, k]) >= limit  # not without a guess
                if far or not abs(d[row, col, k]) < limit:
                    return False
            border += row in (PADDING, rows - PADDING - 1) or col in (PADDING, cols - PADDING - 1)
    for row in range(PADDING, rows - PADDING):
        for col in range(PADDING, cols - PADDING):
            r, c = row - PADDING, col - PADDING
            known = math.isfinite(guess[row, col, 0] + guess[row, col, 1])
            if flags[row, col] != 0 or known or label[r, c] != 0:
                continue
            seed = r * label.shape[1] + c
            reaches, end = _reaches_guess(seed, d, sigma, flags, guess, period, path, label, cut_off)
            if reaches:
                continue
            # more nodes than these might settle their order by the view's border
            if end - cut_off >= min(FEW, BORDER_SHARE * border):
                return False
            cut_off = end
    for node in path[:cut_off]:
        flags[node // label.shape[1] + PADDING, node % label.shape[1] + PADDING] |= AMBIGUOUS
    return True
