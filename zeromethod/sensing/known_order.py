"""Unwrapping where nothing is to be unwrapped: near the null, with dark places and what they cut off.

All nodes are near where they are expected, so that no edge jumps and order 0 is right wherever an order can
be known at all. What is left is to flag the few nodes that are cut off from all of which something is known.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from zeromethod.arrays import Flags, Float
from zeromethod.warp.grid import INNER
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
"""Nodes without a guess, in one region, that may settle their order by the view's border."""

_ALL, _FIRST, _LAST = slice(None), slice(1, None), slice(None, -1)
EDGES = (
    ((..., _ALL, _LAST), (..., _ALL, _FIRST)),
    ((..., _LAST, _ALL), (..., _FIRST, _ALL)),
)
"""Nodes at both ends of the edges to the right and downwards: parts of arrays (..., rows, cols)."""


def is_near_null(d: Float, flags: Flags, period: float) -> bool:
    """Whether all nodes are within a quarter period (no edge jumps) and holes too few to cut off a region."""
    inner, limit = flags[INNER], period / 4
    bad = inner != 0
    # nodes covered by coded strips are whole edges of the view, which cut nothing off
    if np.count_nonzero(bad & ((inner & np.uint16(_OUTSIDE)) == 0)) > 3:
        return False
    if d.max() <= limit and d.min() >= -limit:
        return True
    far = np.abs(d[INNER]) > limit
    return not ((far[..., 0] | far[..., 1]) & ~bad).any()


def settle_known_order(d: Float, sigma: Float, flags: Flags, guess: Float, period: float) -> bool:
    """Do what unwrapping does where all nodes are within a quarter period of 0 and of what is expected.

    No edge jumps then, and order 0 is right in all regions with a guess. A few nodes may have none and not be
    joined to any that has: they become ambiguous. False, and nothing is done, for any other residual.
    """
    d, sigma, flags, guess = d[INNER], sigma[INNER], flags[INNER], guess[INNER]
    good = flags == 0
    near = (np.abs(d) < period / 4) & ~(np.abs(d - guess) >= period / 4)  # no guess is no difference
    if not (near[..., 0] & near[..., 1])[good].all():
        return False
    known = np.isfinite(guess[..., 0] + guess[..., 1])
    without = good & ~known
    if not without.any():
        return True
    d, sigma = np.moveaxis(d, -1, 0), np.moveaxis(sigma, -1, 0)
    number = np.cumsum(without).reshape(without.shape) - 1
    reaches = np.zeros(np.count_nonzero(without), np.bool_)
    pairs = []
    for here, there in EDGES:
        steep = np.abs(d[there] - d[here]) + (sigma[here] + sigma[there])
        flat = 508.0 / period * np.maximum(*steep) < int(STEEPEST * 254) + 1
        joined = good[here] & good[there] & flat
        reaches[number[here][joined & without[here] & known[there]]] = True
        reaches[number[there][joined & without[there] & known[here]]] = True
        both = joined & without[here] & without[there]
        pairs.append((number[here][both], number[there][both]))
    one, other = np.concatenate(pairs, axis=1)
    size = len(reaches), len(reaches)
    _, region = connected_components(csr_array((np.ones(len(one)), (one, other)), shape=size), directed=False)
    cut_off = np.bincount(region, weights=reaches) == 0
    border = sum(map(np.count_nonzero, (good[0], good[-1], good[1:-1, 0], good[1:-1, -1])))
    # more nodes than these might settle their order by the view's border
    if (np.bincount(region)[cut_off] >= min(FEW, BORDER_SHARE * border)).any():
        return False
    flags[without] |= np.where(cut_off[region], AMBIGUOUS, 0).astype(np.uint16)
    return True
