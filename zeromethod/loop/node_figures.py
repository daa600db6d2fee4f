"""Figures of all nodes of a frame, in one pass each: left to null, seen, away from rest."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.warp.validity import Flag

_LIGHT_LOST, _CODED = int(Flag.LIGHT_LOST), int(Flag.CODED)


@numba.njit(cache=True)
def node_figures(d: Float, nulled: Mask, valid: Mask, seen: Mask, flags: Flags) -> tuple[float, float, float]:
    """(mean square length of d over nulled nodes; valid share of the seen ones, and that without light).

    flags: of the measured warp. A node that sees coded pictures may look dark and be lit.
    """
    total = 0.0
    nodes = both = wanted = dark = 0
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            if seen[j, i]:
                wanted += 1
                dark += flags[j, i] & _LIGHT_LOST != 0 and flags[j, i] & _CODED == 0
            both += valid[j, i] and seen[j, i]
            if nulled[j, i]:
                nodes += 1
                total += d[j, i, 0] ** 2 + d[j, i, 1] ** 2
    return total / nodes if nodes else np.nan, both / max(wanted, 1), dark / max(wanted, 1)


@numba.njit(cache=True)
def away_from_rest(q: Float, q_rest: Float, sigma: Float, valid: Mask, size: int) -> tuple[float, float]:
    """(largest mean square displacement of any block, mean sigma^2), both per component, LCD px^2."""
    rows, cols = valid.shape
    largest = noise = 0.0
    every = 0
    for top in range(0, rows, size):
        for left in range(0, cols, size):
            total = 0.0
            nodes = 0
            for j in range(top, min(top + size, rows)):
                for i in range(left, min(left + size, cols)):
                    if valid[j, i]:
                        nodes += 1
                        for k in range(2):
                            total += 0.5 * (q[j, i, k] - q_rest[j, i, k]) ** 2
                            noise += 0.5 * sigma[j, i, k] ** 2
            if nodes:
                every += nodes
                largest = max(largest, total / nodes)
    return largest, noise / max(every, 1)
