"""Spatial phase unwrapping: which period of the carrier each node observes, after a sudden press.

A flood over the lattice of valid nodes, least uncertain edge first (steepness and sigma), carries the order
from node to node, for both components together. What the flood cannot decide is flagged AMBIGUOUS: nodes
around a residue (the order differs with the path), nodes at an edge that disagrees with the flood, regions
whose absolute order is undetermined. The absolute order of a connected region comes from a guess of the
displacement, where most of the region lies within a quarter period of it, else from its share of the
border of the view, which is assumed to be at rest: the order for which most of these nodes are nearest zero.

Quality-guided path following: Ghiglia and Pritt, Two-Dimensional Phase Unwrapping, Wiley 1998, chapter 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Flags, Float
from zeromethod.sensing.known_order import (
    AMBIGUOUS,
    AS_GUESSED,
    BORDER_SHARE,
    STEEPEST,
    is_near_null,
    settle_known_order,
)
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import PADDING, NodeGrid

MOST_ORDERS = 64
"""Largest order considered, periods."""

BLOCKED = 255
Ints = NDArray[np.int32]
Jumps = NDArray[np.int8]


class _Work(NamedTuple):
    """Work space: jumps and costs of edges; label, order and border of nodes; the flood's queue and path.

    border_share: least share of the border's nodes by which a region's order is settled.
    """

    jumps: Jumps
    costs: Bytes
    label: Ints
    order: Ints
    border: Bytes
    head: Ints
    after: Ints
    path: Ints
    votes: Ints
    border_share: float


class Unwrapper:
    """Unwrapping on one grid. diagonal: the residual comes as displacements along u + v and u - v.

    parted: what seams cut off is brought nearest to rest; its order is settled later (`loop.across_seams`).
    """

    def __init__(self, grid: NodeGrid, *, diagonal: bool, parted: bool = False) -> None:
        rows, cols = (n - 2 * PADDING for n in grid.shape)
        self._period = float(grid.period_px)
        self._diagonal = diagonal
        self._work = _Work(
            jumps=np.zeros((2, rows, cols, 2), np.int8),
            costs=np.full((2, rows, cols), BLOCKED, np.uint8),
            label=np.zeros((rows, cols), np.int32),
            order=np.zeros((rows, cols, 2), np.int32),
            border=np.zeros((rows, cols), np.uint8),
            head=np.full(BLOCKED, -1, np.int32),
            after=np.zeros(4 * rows * cols, np.int32),
            path=np.zeros(rows * cols, np.int32),
            votes=np.zeros((2, 2 * MOST_ORDERS + 1), np.int32),
            border_share=0.0 if parted else BORDER_SHARE,
        )
        self._no_guess = np.zeros((0, 0, 2))

    def unwrap(self, residual: Residual, guess: Float | None = None, continued: Float | None = None) -> None:
        """Unwrap `residual.d` in place and flag nodes that stay ambiguous; near null nothing is to be done.

        guess: (rows, cols, 2) px expected displacement, NaN = none. continued: the same, finite where it is
        only continued from nodes around.
        """
        if not is_near_null(residual.d, residual.flags, self._period):
            expected, steps = self._to_carriers(guess), self._to_carriers(continued)
            given = residual.d, residual.sigma, residual.flags, expected
            work = self._work
            if guess is None or not settle_known_order(*given, self._period, work.path, work.label):
                _unwrap(*given, steps, self._period, work)
        if self._diagonal:
            _from_diagonal(residual.d)

    def _to_carriers(self, guess: Float | None) -> Float:
        if guess is None:
            return self._no_guess
        guess = np.ascontiguousarray(guess, dtype=np.float64)
        if not self._diagonal:
            return guess
        return np.stack([guess[..., 0] + guess[..., 1], guess[..., 0] - guess[..., 1]], axis=-1)


@numba.njit(cache=True)
def _from_diagonal(d: Float) -> None:
    for row in range(PADDING, d.shape[0] - PADDING):
        for col in range(PADDING, d.shape[1] - PADDING):
            p, m = d[row, col, 0], d[row, col, 1]
            d[row, col, 0], d[row, col, 1] = 0.5 * (p + m), 0.5 * (p - m)


@numba.njit(cache=True)
def _rate_edges(
    d: Float, sigma: Float, flags: Flags, continued: Float, period: float, jumps: Jumps, costs: Bytes
) -> None:
    """Jump (periods) and cost (0..254, or BLOCKED) of every edge: to the right (0), downwards (1).

    Where the step is nearly the continued guess's but for whole periods, both are those of the difference: a
    step of half a period, as the summit of a deep dent has in an open loop, would go either way by noise.
    """
    rows, cols = costs.shape[1:]
    scale, inverse = 508.0 / period, 1.0 / period
    highest = int(STEEPEST * 254)
    for r in range(rows):
        for c in range(cols):
            a, b = r + PADDING, c + PADDING
            for way in range(2):
                costs[way, r, c] = BLOCKED
                jumps[way, r, c, 0], jumps[way, r, c, 1] = 0, 0
                p, q = (a, b + 1) if way == 0 else (a + 1, b)
                if flags[a, b] | flags[p, q]:
                    continue
                steep = 0.0
                for k in range(2):
                    step = d[p, q, k] - d[a, b, k]
                    if continued.size > 0:
                        apart = step - (continued[p, q, k] - continued[a, b, k])
                        if abs(apart - period * np.rint(apart * inverse)) < AS_GUESSED * period:
                            step = apart
                    jump = -np.rint(step * inverse)
                    jumps[way, r, c, k] = int(jump)
                    noise = sigma[a, b, k] + sigma[p, q, k]
                    steep = max(steep, abs(step + jump * period) + noise)
                cost = int(steep * scale)
                if cost <= highest:
                    costs[way, r, c] = cost


@numba.njit(cache=True)
def _drop_residues(flags: Flags, jumps: Jumps, costs: Bytes) -> None:
    """Flag the four nodes of every mesh with a residue (jumps that do not close) and block their edges."""
    rows, cols = costs.shape[1:]
    right, down = jumps[0], jumps[1]
    for r in range(rows - 1):
        for c in range(cols - 1):
            y, x = r + PADDING, c + PADDING
            if (flags[y, x] | flags[y, x + 1] | flags[y + 1, x] | flags[y + 1, x + 1]) & ~AMBIGUOUS:
                continue
            for k in range(2):
                if right[r, c, k] + down[r, c + 1, k] - right[r + 1, c, k] - down[r, c, k] != 0:
                    for b in (y, y + 1):
                        for a in (x, x + 1):
                            flags[b, a] |= AMBIGUOUS
    for r in range(rows):
        for c in range(cols):
            here = flags[r + PADDING, c + PADDING]
            if (here | flags[r + PADDING, c + PADDING + 1]) & AMBIGUOUS:
                costs[0, r, c] = BLOCKED
            if (here | flags[r + PADDING + 1, c + PADDING]) & AMBIGUOUS:
                costs[1, r, c] = BLOCKED


@numba.njit(cache=True)
def _mark(flags: Flags, border: Bytes, r: int, c: int, stack: Ints, top: int) -> int:
    """Mark a node not yet marked: 1 valid, 2 invalid, which goes onto the stack; the stack's height."""
    if border[r, c] == 0:
        border[r, c] = 1 if flags[r + PADDING, c + PADDING] & ~AMBIGUOUS == 0 else 2
        if border[r, c] == 2:
            stack[top] = r * border.shape[1] + c
            return top + 1
    return top


@numba.njit(cache=True)
def _mark_border(flags: Flags, border: Bytes, stack: Ints) -> int:
    """Mark (1) the valid nodes at the view's border or next to invalid nodes joined to it; their number."""
    rows, cols = border.shape
    border[:] = 0
    top = 0
    for r in range(rows):
        step = 1 if r in (0, rows - 1) else max(cols - 1, 1)
        for c in range(0, cols, step):
            top = _mark(flags, border, r, c, stack, top)
    while top > 0:
        top -= 1
        r, c = stack[top] // cols, stack[top] % cols
        for y in range(max(r - 1, 0), min(r + 2, rows)):
            for x in range(max(c - 1, 0), min(c + 2, cols)):
                top = _mark(flags, border, y, x, stack, top)
    return int(np.sum(border == 1))


@numba.njit(cache=True)
def _flood(seed: int, mark: int, work: _Work) -> int:
    """Carry the order from `seed` through its region; `work.path` receives its nodes; their number.

    The queue of edges is 255 stacks (`head`, empty before and after), one per cost; an edge is
    4 x its source + its way.
    """
    jumps, costs, label, order = work.jumps, work.costs, work.label, work.order
    head, after, path = work.head, work.after, work.path
    cols = label.shape[1]
    lowest, count = BLOCKED, 0
    node = seed
    r, c = node // cols, node % cols
    order[r, c, 0], order[r, c, 1] = 0, 0
    while True:
        label[r, c] = mark
        path[count] = node
        count += 1
        for way in range(4):
            y, x = r - (way == 3), c - (way == 2)
            if y < 0 or x < 0:
                continue
            cost = costs[way & 1, y, x]
            to_r, to_c = r + (way == 1) - (way == 3), c + (way == 0) - (way == 2)
            if cost == BLOCKED or label[to_r, to_c] != 0:
                continue
            edge = 4 * node + way
            after[edge] = head[cost]
            head[cost] = edge
            lowest = min(lowest, cost)
        found = False
        while lowest < BLOCKED and not found:
            edge = head[lowest]
            if edge < 0:
                lowest += 1
                continue
            head[lowest] = after[edge]
            way, source = edge & 3, edge >> 2
            y, x = source // cols, source % cols
            r, c = y + (way == 1) - (way == 3), x + (way == 0) - (way == 2)
            if label[r, c] == 0:
                found = True
                node = r * cols + c
                ey, ex, sign = (y, x, 1) if way < 2 else (r, c, -1)
                for k in range(2):
                    order[r, c, k] = order[y, x, k] + sign * jumps[way & 1, ey, ex, k]
        if not found:
            return count


@numba.njit(cache=True)
def _winner(votes: Ints) -> tuple[int, int]:
    """(order with most votes, its votes) of one component."""
    best = int(np.argmax(votes))
    return best - MOST_ORDERS, int(votes[best])


@numba.njit(cache=True)
def _region_order(
    d: Float, guess: Float, period: float, work: _Work, least_nodes: float, region: Ints
) -> tuple[bool, int, int]:
    """(whether at least `least_nodes` of a region count and most of them agree, the orders to add).

    Nodes with a guess count, and agree when they then lie within a quarter period of it. Without any guess
    (of size 0) those at the border count, and are brought nearest to zero.
    """
    order, votes, guessed = work.order, work.votes, guess.size > 0
    votes[:] = 0
    nodes = 0
    for node in region:
        r, c = node // order.shape[1], node % order.shape[1]
        a, b = r + PADDING, c + PADDING
        if not (np.isfinite(guess[a, b, 0] + guess[a, b, 1]) if guessed else work.border[r, c] == 1):
            continue
        nodes += 1
        for k in range(2):
            away = ((guess[a, b, k] if guessed else 0.0) - d[a, b, k]) / period
            orders = int(np.rint(away - order[r, c, k]))
            close = not guessed or abs(away - order[r, c, k] - orders) < 0.25
            if close and abs(orders) <= MOST_ORDERS:
                votes[k, orders + MOST_ORDERS] += 1
    (nu, most_u), (nv, most_v) = _winner(votes[0]), _winner(votes[1])
    return nodes >= least_nodes and 2 * min(most_u, most_v) > nodes, nu, nv


@numba.njit(cache=True)
def _flag_disagreement(flags: Flags, jumps: Jumps, costs: Bytes, label: Ints, order: Ints) -> None:
    """Flag both ends of every edge whose jump differs from the flood's."""
    rows, cols = label.shape
    for r in range(rows):
        for c in range(cols):
            for way in range(2):
                if costs[way, r, c] == BLOCKED:
                    continue
                y, x = (r, c + 1) if way == 0 else (r + 1, c)
                for k in range(2):
                    if order[y, x, k] - order[r, c, k] != jumps[way, r, c, k]:
                        flags[r + PADDING, c + PADDING] |= AMBIGUOUS
                        flags[y + PADDING, x + PADDING] |= AMBIGUOUS


@numba.njit(cache=True)
def _unwrap(
    d: Float, sigma: Float, flags: Flags, guess: Float, continued: Float, period: float, work: _Work
) -> None:
    jumps, costs, label, order = work.jumps, work.costs, work.label, work.order
    rows, cols = label.shape
    _rate_edges(d, sigma, flags, continued, period, jumps, costs)
    _drop_residues(flags, jumps, costs)
    border_nodes = _mark_border(flags, work.border, work.path)
    label[:] = 0
    order[:] = 0
    mark = 0
    for seed in range(rows * cols):
        r, c = seed // cols, seed % cols
        if label[r, c] != 0 or flags[r + PADDING, c + PADDING] != 0:
            continue
        mark += 1
        count = _flood(seed, mark, work)
        region = work.path[:count]
        determined, nu, nv = False, 0, 0
        if guess.size > 0:
            determined, nu, nv = _region_order(d, guess, period, work, 0.0, region)
        if not determined:
            least = work.border_share * border_nodes
            determined, nu, nv = _region_order(d, np.zeros((0, 0, 2)), period, work, least, region)
        for node in region:
            y, x = node // cols, node % cols
            order[y, x, 0] += nu
            order[y, x, 1] += nv
            if not determined:
                flags[y + PADDING, x + PADDING] |= AMBIGUOUS
    _flag_disagreement(flags, jumps, costs, label, order)
    for r in range(rows):
        for c in range(cols):
            if label[r, c] != 0:
                for k in range(2):
                    d[r + PADDING, c + PADDING, k] += period * order[r, c, k]
