"""Slopes of a surface in blocks of nodes: nodes alone where something presses, larger blocks away from it.

Far from contacts slopes change little from node to node, and a block's mean says what all its nodes say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.contact.contact import Contact
from zeromethod.surface import Surface

_NEAR_MM = 1.0
"""Nodes within a contact's smaller axis and so many mm of its border stand alone; those up to twice as far
are in blocks of 2 x 2, and so on."""
_SIDES = np.array([1, 2, 4, 8])
LARGEST = int(_SIDES[-1])
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
        whole = surface.valid | ~surface.on_mirror
        away = np.asarray(cv2.distanceTransform(whole.view(np.uint8), cv2.DIST_L2, 3), np.float64)
        usable, every_sigma2 = _usable(surface), surface.sigma_slope**2
        row, col = at = np.nonzero(usable & np.isfinite(every_sigma2.sum(axis=-1)))
        x, y, slope, sigma2 = surface.x_mm[at], surface.y_mm[at], surface.slope[at], every_sigma2[at]
        level = _level(x, y, contacts)
        place = level, row // _SIDES[level], col // _SIDES[level]
        key = np.ravel_multi_index(place, (len(_SIDES), *usable.shape))
        keys, own = np.unique(key, return_inverse=True)
        count = len(keys)
        weight = 2 / sigma2.sum(axis=1)
        weight /= np.bincount(own, weight, count)[own]

        def mean(*values: Float) -> Float:
            return np.stack([np.bincount(own, weight * one, count) for one in values], axis=-1)

        at_mm = mean(x, y)
        rim = _RIM * np.exp(-away[at] / _RIM_NODES) * (away[at] < 10 * _RIM_NODES)
        block, share = np.full(usable.shape, -1), np.zeros(usable.shape)
        block[at], share[at] = own, weight
        of_constant = surface.slope_by_constant
        return cls(
            slope=mean(*slope.T),
            variance=mean(*(weight[:, None] * sigma2).T),
            by_constant=np.zeros((count, 2)) if of_constant is None else mean(*of_constant[at].T),
            rim=mean(rim)[:, 0],
            nodes=np.bincount(own, minlength=count).astype(np.float64),
            at_mm=at_mm,
            spread_mm2=mean((x - at_mm[own, 0]) ** 2, (y - at_mm[own, 1]) ** 2),
            block=block,
            weight=share,
        )

    def alone(self) -> NDArray[np.int64]:
        """(blocks of one node,) which nodes they are, counted along rows."""
        used = np.flatnonzero(self.block >= 0)
        block = self.block.ravel()[used]
        alone = self.nodes[block] == 1
        return np.asarray(used[alone][np.argsort(block[alone])])

    def now(self, surface: Surface) -> tuple[Float, Float]:
        """Slopes (n, 2) of another reading, times the share (n,) of each block that is read in it."""
        read = _usable(surface) & (self.block >= 0)
        own, weight, slope, count = self.block[read], self.weight[read], surface.slope[read], len(self.slope)
        each = weight * slope[:, 0], weight * slope[:, 1], weight
        x, y, share = (np.bincount(own, one, count).astype(np.float64, copy=False) for one in each)
        return np.stack((x, y), axis=-1), share


def _usable(surface: Surface) -> Mask:
    """Read nodes, all of whose neighbours on the mirror are read."""
    whole = (surface.valid | ~surface.on_mirror).view(np.uint8)
    return np.asarray(surface.valid & (cv2.erode(whole, _AROUND) > 0))


def _level(x_mm: Float, y_mm: Float, contacts: Sequence[Contact]) -> NDArray[np.intp]:
    """(n,) which of `_SIDES` the block of each place (n,) has."""
    level = np.full(len(x_mm), len(_SIDES) - 1)
    for one in contacts:
        away = np.hypot(x_mm - one.x_mm, y_mm - one.y_mm)
        within = one.major_mm / 2 + (one.minor_mm / 2 + _NEAR_MM) * _SIDES[:-1]
        level = np.minimum(level, np.searchsorted(within, away))
    return level
