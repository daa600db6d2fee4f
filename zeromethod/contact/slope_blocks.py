"""Slopes of a surface in blocks of nodes: nodes alone where something presses, larger blocks away from it.

Far from contacts slopes change little from node to node, and a block's mean says what all its nodes say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask, Single
from zeromethod.contact.contact import Contact
from zeromethod.surface import Surface

_NEAR_MM = 1.0
"""Nodes within a contact's smaller axis and so many mm of its border stand alone; those up to twice as far
are in blocks of 2 x 2, and so on."""
LARGEST = 8
_SUMS = 11
_RIM, _RIM_NODES = 0.1, 0.8
"""Windows reach across a hole's rim: slopes are off by 5 to 15 % at the first node, which is left out, by one
at the next, and less beyond. Relative error where nodes end, and over how many nodes it falls to a third."""
_AROUND = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class SlopeBlocks:
    """Which nodes make a block, and what is known of its mean slope.

    slope: (n, 2) when the blocks were made, and its variance (n, 2) by noise of nodes that is independent;
    by_constant: (n, 2) its change, 1/mm, by an error of depth's constant.
    rim: (n,) relative error that rims of unread nodes leave open. nodes: (n,) of each block. at_mm,
    spread_mm2: (n, 2) its middle, and the variance of its nodes' places along x and y. block, weight: (rows,
    cols) to which block a node counts, -1 for none, and how much.
    """

    slope: Float
    variance: Float
    by_constant: Float
    rim: Float
    nodes: Float
    at_mm: Float
    spread_mm2: Float
    block: NDArray[np.int64]
    weight: Float

    @classmethod
    def of(cls, surface: Surface, contacts: Sequence[Contact]) -> SlopeBlocks:
        """All valid nodes of a surface, in blocks; those alone come first."""
        middles = np.array([(c.x_mm, c.y_mm, c.major_mm / 2, c.minor_mm / 2 + _NEAR_MM) for c in contacts])
        whole = surface.valid | ~surface.on_mirror
        away = np.asarray(cv2.distanceTransform(whole.view(np.uint8), cv2.DIST_L2, 3), np.float32)
        usable, of_constant = _usable(surface), surface.slope_by_constant
        block, weight, sums = _summed(
            surface.slope, surface.sigma_slope, surface.x_mm, surface.y_mm, usable, away, middles, LARGEST
        )
        mean, nodes = sums[:, 1:-1] / sums[:, :1], sums[:, -1]
        spread = np.where(nodes[:, None] > 1, np.maximum(mean[:, 2:4] - mean[:, :2] ** 2, 0.0), 0.0)
        variance = mean[:, 6:8] / sums[:, :1]
        of_constant = np.zeros_like(surface.slope) if of_constant is None else of_constant
        by_constant, _ = _means(of_constant, usable, block, weight, len(nodes))
        at_mm = mean[:, :2].copy()
        return cls(mean[:, 4:6], variance, by_constant, mean[:, 8], nodes, at_mm, spread, block, weight)

    def alone(self) -> NDArray[np.int64]:
        """(blocks of one node,) which nodes they are, counted along rows."""
        used = np.flatnonzero(self.block >= 0)
        block = self.block.ravel()[used]
        alone = self.nodes[block] == 1
        return np.asarray(used[alone][np.argsort(block[alone])])

    def now(self, surface: Surface) -> tuple[Float, Float]:
        """Slopes (n, 2) of another reading, times the share (n,) of each block that is read in it."""
        return _means(surface.slope, _usable(surface), self.block, self.weight, len(self.slope))


def _usable(surface: Surface) -> Mask:
    """Read nodes, all of whose neighbours on the mirror are read."""
    whole = (surface.valid | ~surface.on_mirror).view(np.uint8)
    return np.asarray(surface.valid & (cv2.erode(whole, _AROUND) > 0))


@numba.njit(cache=True, nogil=True)
def _level(x: float, y: float, middles: Float, within2: Float) -> int:
    """Size of a place's block, as its power of 2. within2: squares of distances up to which it is each."""
    level: int = within2.shape[1]
    for k in range(len(middles)):
        away2 = (x - middles[k, 0]) ** 2 + (y - middles[k, 1]) ** 2
        while level > 0 and away2 <= within2[k, level - 1]:
            level -= 1
    return level


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _summed(
    slope: Float,
    sigma: Float,
    x_mm: Float,
    y_mm: Float,
    valid: Mask,
    away_nodes: Single,
    middles: Float,
    largest: int,
) -> tuple[NDArray[np.int64], Float, Float]:
    """Each node's block, -1 for none, and its weight, (rows, cols); sums (blocks, 11) over their nodes.

    Sums of weights, and of weights times x, y, x^2, y^2, slopes, variance times weight, and rim; of nodes.
    away_nodes: distance from unread nodes. middles: (contacts, 4) x, y, half size, and reach beyond it.
    """
    rows, cols = valid.shape
    starts, sides = [0], [1]
    while sides[-1] <= largest:
        side = sides[-1]
        starts.append(starts[-1] + ((rows + side - 1) // side) * ((cols + side - 1) // side))
        sides.append(2 * side)
    within2 = (middles[:, 2:3] + middles[:, 3:] * np.array(sides[:-2])) ** 2
    block = np.full((rows, cols), -1)
    share = np.zeros((rows, cols))
    # few of all possible blocks have nodes: rows of sums are begun where the first node of one is
    number, key = np.full(starts[-1], -1), np.empty(rows * cols, np.int64)
    sums, count = np.empty((rows * cols, _SUMS)), 0
    for i in range(rows):
        for j in range(cols):
            if not (valid[i, j] and np.isfinite(sigma[i, j, 0] + sigma[i, j, 1])):
                continue
            x, y = x_mm[i, j], y_mm[i, j]
            level = _level(x, y, middles, within2)
            side = sides[level]
            place = starts[level] + (i // side) * ((cols + side - 1) // side) + j // side
            if number[place] < 0:
                number[place], key[count] = count, place
                sums[count] = 0.0
                count += 1
            block[i, j] = number[place]
            own = sums[number[place]]
            weight = 2.0 / (sigma[i, j, 0] ** 2 + sigma[i, j, 1] ** 2)
            share[i, j] = weight
            own[0] += weight
            own[1] += weight * x
            own[2] += weight * y
            own[3] += weight * x * x
            own[4] += weight * y * y
            for c in range(2):
                own[5 + c] += weight * slope[i, j, c]
                own[7 + c] += weight * weight * sigma[i, j, c] ** 2
            if away_nodes[i, j] < 10 * _RIM_NODES:
                own[9] += weight * _RIM * np.exp(-away_nodes[i, j] / _RIM_NODES)
            own[10] += 1.0
    order = np.argsort(key[:count])
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    for i in range(rows):
        for j in range(cols):
            if block[i, j] >= 0:
                share[i, j] /= sums[block[i, j], 0]
                block[i, j] = rank[block[i, j]]
    return block, share, sums[order]


@numba.njit(cache=True, nogil=True)
def _means(
    slope: Float, valid: Mask, block: NDArray[np.int64], weight: Float, count: int
) -> tuple[Float, Float]:
    """Means (count, 2) over the valid nodes of each block, times the share (count,) of them."""
    sums, share = np.zeros((count, 2)), np.zeros(count)
    for i in range(valid.shape[0]):
        for j in range(valid.shape[1]):
            if valid[i, j] and block[i, j] >= 0:
                for c in range(2):
                    sums[block[i, j], c] += weight[i, j] * slope[i, j, c]
                share[block[i, j]] += weight[i, j]
    return sums, share


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    one, two, valid = np.ones((1, 1)), np.ones((1, 1, 2)), np.ones((1, 1), np.bool_)
    block, weight, _ = _summed(two, two, one, one, valid, one.astype(np.float32), np.ones((1, 4)), LARGEST)
    _means(two, valid, block, weight, 1)
