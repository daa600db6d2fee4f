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

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Bytes, Flags, Float, Mask
from zeromethod.kernels import kernel, read
from zeromethod.sensing.known_order import (
    AMBIGUOUS,
    AS_GUESSED,
    BORDER_SHARE,
    EDGES,
    STEEPEST,
    is_near_null,
    settle_known_order,
)
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import INNER, PADDING, NodeGrid

MOST_ORDERS = 64
"""Largest order considered, periods."""

BLOCKED = 255
Whole = NDArray[np.int32]


class Unwrapper:
    """Unwrapping on one grid. diagonal: the residual comes as displacements along u + v and u - v.

    parted: what seams cut off is brought nearest to rest; its order is settled later (`loop.across_seams`).
    """

    def __init__(self, grid: NodeGrid, *, diagonal: bool, parted: bool = False) -> None:
        self._period = float(grid.period_px)
        self._diagonal = diagonal
        self._border_share = 0.0 if parted else BORDER_SHARE

    def unwrap(self, residual: Residual, guess: Float | None = None, continued: Float | None = None) -> None:
        """Unwrap `residual.d` in place and flag nodes that stay ambiguous; near null nothing is to be done.

        guess: (rows, cols, 2) px expected displacement, NaN = none. continued: the same, finite where it is
        only continued from nodes around.
        """
        if not is_near_null(residual.d, residual.flags, self._period):
            expected, steps = self._to_carriers(guess), self._to_carriers(continued)
            given = residual.d, residual.sigma, residual.flags
            if expected is None or not settle_known_order(*given, expected, self._period):
                unwrap_orders(*given, expected, steps, self._period, self._border_share)
        if self._diagonal:
            along, against = residual.d[INNER][..., 0].copy(), residual.d[INNER][..., 1].copy()
            residual.d[INNER][..., 0] = 0.5 * (along + against)
            residual.d[INNER][..., 1] = 0.5 * (along - against)

    def _to_carriers(self, guess: Float | None) -> Float | None:
        if guess is None or not self._diagonal:
            return guess
        return np.stack([guess[..., 0] + guess[..., 1], guess[..., 0] - guess[..., 1]], axis=-1)


def unwrap_orders(
    d: Float,
    sigma: Float,
    flags: Flags,
    guess: Float | None,
    continued: Float | None,
    period: float,
    border_share: float,
) -> None:
    """Unwrap d and flag what stays ambiguous; arrays (rows, cols, ...) with padding, d and flags in place.

    guess, continued: as for `Unwrapper.unwrap`, along the carriers. border_share: least share of the border's
    nodes by which a region's order is settled.
    """
    whole_flags, flags = flags, flags[INNER]
    jumps, costs = np.zeros((2, 2, *flags.shape), np.int32), np.full((2, *flags.shape), BLOCKED, np.uint8)
    steps = np.zeros((0, 0, 2)) if continued is None else continued
    _rate_edges(d, sigma, whole_flags, steps, period, jumps, costs)
    _drop_residues(flags, jumps, costs)
    wrapped = _by_component(d)
    label, order = np.zeros(flags.shape, np.int32), np.zeros(wrapped.shape, np.int32)
    head, after = np.full(BLOCKED, -1, np.int32), np.empty(4 * flags.size, np.int32)
    count = 1 + _flood(jumps, costs, flags == 0, label, order, head, after)
    orders, determined = np.zeros((2, count), np.int64), np.zeros(count, np.bool_)
    if guess is not None:
        expected = _by_component(guess)
        known = np.isfinite(expected[0] + expected[1])
        _, determined, orders = _region_orders(wrapped, expected, known, label, order, period, count)
    if not determined[1:].all():
        border = _border(flags)
        nodes, agreed, nearest = _region_orders(wrapped, None, border, label, order, period, count)
        orders = np.where(determined, orders, nearest)
        determined |= agreed & (nodes >= border_share * np.count_nonzero(border))
    orders[:, 0], determined[0] = 0, True  # flagged nodes, of no region
    order += orders[:, label]
    flags |= (~determined * np.uint16(AMBIGUOUS))[label]
    _flag_disagreement(flags, jumps, costs, order)
    d[INNER] += period * np.moveaxis(order, 0, -1)


def _by_component(field: Float) -> Float:
    """(2, rows, cols) of the measurable nodes of a field (rows, cols, 2) with padding."""
    return np.ascontiguousarray(np.moveaxis(field[INNER], -1, 0))


@kernel(
    read(numba.float64, 3),
    read(numba.float64, 3),
    read(numba.uint16, 2),
    read(numba.float64, 3),
    numba.float64,
    numba.int32[:, :, :, ::1],
    numba.uint8[:, :, ::1],
)
def _rate_edges(
    d: Float, sigma: Float, flags: Flags, continued: Float, period: float, jumps: Whole, costs: Bytes
) -> None:
    """Jump (periods) and cost (0..254, or BLOCKED) of every edge: to the right (0), downwards (1).

    Fields with padding, continued (0, 0, 2) for none; jumps (2, 2, rows, cols) and costs (2, rows, cols) of
    measurable nodes, by way first, all 0 and BLOCKED before. Where the step is nearly the continued guess's
    but for whole periods, both are those of the difference: a step of half a period, as the summit of a deep
    dent has in an open loop, would go either way by noise.
    """
    scale, inverse = 508.0 / period, 1.0 / period
    highest = int(STEEPEST * 254)
    for r in range(costs.shape[1]):
        for c in range(costs.shape[2]):
            a, b = r + PADDING, c + PADDING
            for way in range(2):
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
                    jumps[way, k, r, c] = int(jump)
                    steep = max(steep, abs(step + jump * period) + (sigma[a, b, k] + sigma[p, q, k]))
                cost = int(steep * scale)
                if cost <= highest:
                    costs[way, r, c] = cost


def _drop_residues(flags: Flags, jumps: Whole, costs: Bytes) -> None:
    """Flag the four nodes of every mesh with a residue (jumps that do not close) and block their edges."""
    right, down = jumps
    left_over = right[:, :-1, :-1] + down[:, :-1, 1:] - right[:, 1:, :-1] - down[:, :-1, :-1]
    bad = (flags & ~np.uint16(AMBIGUOUS)) != 0
    bad_mesh = bad[:-1, :-1] | bad[:-1, 1:] | bad[1:, :-1] | bad[1:, 1:]
    residue = ~bad_mesh & (left_over != 0).any(axis=0)
    for rows in (slice(None, -1), slice(1, None)):
        for cols in (slice(None, -1), slice(1, None)):
            flags[rows, cols][residue] |= np.uint16(AMBIGUOUS)
    ambiguous = (flags & np.uint16(AMBIGUOUS)) != 0
    for way, (here, there) in enumerate(EDGES):
        costs[way][here][ambiguous[here] | ambiguous[there]] = BLOCKED


def _border(flags: Flags) -> Mask:
    """Valid nodes at the view's border or next to invalid nodes joined to it."""
    invalid = (flags & ~np.uint16(AMBIGUOUS)) != 0
    beyond = np.pad(invalid, 1, constant_values=True)  # all round the view
    _, labels = cv2.connectedComponents(beyond.view(np.uint8), connectivity=8)
    joined = (labels == labels[0, 0]).astype(np.uint8)
    near: Mask = cv2.dilate(joined, np.ones((3, 3), np.uint8))[1:-1, 1:-1] != 0
    return np.asarray(near & ~invalid)


@kernel(
    read(numba.int32, 4),
    read(numba.uint8, 3),
    read(numba.boolean, 2),
    numba.int32[:, ::1],
    numba.int32[:, :, ::1],
    numba.int32[::1],
    numba.int32[::1],
)
def _flood(
    jumps: Whole, costs: Bytes, valid: Mask, label: Whole, order: Whole, head: Whole, after: Whole
) -> int:
    """Carry the order from a first node through each region of valid nodes; number of regions.

    label: (rows, cols) of zeros, becomes the region of each node, 1 and up. order: (2, rows, cols). The queue
    of edges is 255 stacks (`head`, -1 before and after), one per cost; an edge is 4 x its source + its way.
    """
    cols, mark = label.shape[1], 0
    for seed in range(label.size):
        r, c = seed // cols, seed % cols
        if label[r, c] != 0 or not valid[r, c]:
            continue
        mark += 1
        lowest, found = BLOCKED, True
        while found:
            label[r, c] = mark
            for way in range(4):
                y, x = r - (way == 3), c - (way == 2)
                if y < 0 or x < 0:
                    continue
                cost = costs[way & 1, y, x]
                if cost == BLOCKED or label[r + (way == 1) - (way == 3), c + (way == 0) - (way == 2)] != 0:
                    continue
                edge = 4 * (r * cols + c) + way
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
                    ey, ex, sign = (y, x, 1) if way < 2 else (r, c, -1)
                    for k in range(2):
                        order[k, r, c] = order[k, y, x] + sign * jumps[way & 1, k, ey, ex]
    return mark


def _region_orders(
    d: Float, guess: Float | None, counts: Mask, label: Whole, order: Whole, period: float, regions: int
) -> tuple[NDArray[np.intp], Mask, NDArray[np.intp]]:
    """(Nodes that count, whether most of them agree, orders to add (2, n)) of every region by its label.

    counts: (rows, cols) nodes that do; those without a region are numbered 0. They agree when they then lie
    within a quarter period of the guess. Without a guess they are brought nearest to zero.
    """
    nodes = np.bincount((label * counts).ravel(), minlength=regions)
    away = ((0.0 if guess is None else guess) - d) / period - order
    whole = np.rint(away)
    votes_for = counts & (np.abs(whole) <= MOST_ORDERS)
    if guess is not None:
        votes_for &= np.abs(away - whole) < 0.25
    choices = 2 * MOST_ORDERS + 1
    place = choices * (label * votes_for) + np.where(votes_for, whole, 0.0).astype(np.int64) + MOST_ORDERS
    votes = np.stack([np.bincount(one.ravel(), minlength=regions * choices) for one in place])
    votes = votes.reshape(2, regions, choices)
    return nodes, 2 * votes.max(axis=2).min(axis=0) > nodes, votes.argmax(axis=2) - MOST_ORDERS


def _flag_disagreement(flags: Flags, jumps: Whole, costs: Bytes, order: Whole) -> None:
    """Flag both ends of every edge whose jump differs from the flood's."""
    for way, (here, there) in enumerate(EDGES):
        differs = order[there] - order[here] != jumps[way][here]
        torn = (costs[way][here] != BLOCKED) & (differs[0] | differs[1])
        flags[here][torn] |= np.uint16(AMBIGUOUS)
        flags[there][torn] |= np.uint16(AMBIGUOUS)
