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
def quiet_share(q: Float, before: Float, flags: Flags, apart: Mask, within: float) -> float:
    """Share of the valid nodes not apart that have moved by less, LCD px; 0 where there are none."""
    nodes = quiet = 0
    for j in range(flags.shape[0]):
        for i in range(flags.shape[1]):
            if flags[j, i] == 0 and not apart[j, i]:
                nodes += 1
                quiet += max(abs(q[j, i, 0] - before[j, i, 0]), abs(q[j, i, 1] - before[j, i, 1])) < within
    return quiet / max(nodes, 1)


@numba.njit(cache=True)
def at_rest(
    q: Float, q_rest: Float, sigma: Float, valid: Mask, half: int, sigmas: float, within: float
) -> bool:
    """Whether displacements, LCD px, are noise: in every block, without the largest quarter of its nodes.

    That leaves out dirt, which moves fewer nodes than a press of rubber does. A block, 2 `half` nodes on a
    side and `half` from the next, is off where the root of its mean square per component is above so many
    sigmas and `within`.
    """
    rows, cols = valid.shape
    parts = np.zeros((2, -(-rows // half), -(-cols // half)))
    noise = 0.0
    for j in range(rows):
        for i in range(cols):
            if valid[j, i]:
                x, y = q[j, i, 0] - q_rest[j, i, 0], q[j, i, 1] - q_rest[j, i, 1]
                parts[0, j // half, i // half] += 0.5 * (x * x + y * y)
                parts[1, j // half, i // half] += 1.0
                noise += 0.5 * (sigma[j, i, 0] ** 2 + sigma[j, i, 1] ** 2)
    limit = (sigmas * np.sqrt(noise / max(parts[1].sum(), 1.0)) + within) ** 2
    for top in range(max(parts.shape[1] - 1, 1)):
        for left in range(max(parts.shape[2] - 1, 1)):
            total, nodes = parts[0, top : top + 2, left : left + 2], parts[1, top : top + 2, left : left + 2]
            if total.sum() > limit * nodes.sum():
                here = slice(half * top, half * (top + 2)), slice(half * left, half * (left + 2))
                if _without_largest(q[here] - q_rest[here], valid[here]) > limit:
                    return False
    return True


@numba.njit(cache=True)
def _without_largest(away: Float, valid: Mask) -> float:
    """Mean square per component of displacements (rows, cols, 2) of valid nodes, least three quarters."""
    squares, nodes = np.empty(valid.size), 0
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            if valid[j, i]:
                squares[nodes] = 0.5 * (away[j, i, 0] ** 2 + away[j, i, 1] ** 2)
                nodes += 1
    return float(np.sort(squares[:nodes])[: nodes - nodes // 4].mean())
