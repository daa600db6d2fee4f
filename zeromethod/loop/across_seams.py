"""Order of the carrier across the seams of a saw, found from the mirror's slopes on both sides.

Elsewhere the order goes from node to node (`sensing.unwrap`). A node at a seam cannot pass it on, as its
window mixes the pictures of two teeth. But the mirror itself is continuous: its slope, continued along a row
in a straight line over the seam, differs from the slope read beyond it by whole periods. Each row with little
curvature votes for a number of periods, and most rows of a seam must agree.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Ints, Mask
from zeromethod.sensing.residual import Residual
from zeromethod.warp.compose import compose
from zeromethod.warp.rest import Rest
from zeromethod.warp.seams import SeamMap, gap_end
from zeromethod.warp.validity import Flag

_MOST_NODES = 24
"""Largest gap, nodes of a row, that counts as a seam; a wider dark place has another cause."""
_CLEAR, _BENT = 0.25, 0.1
"""Periods: a row votes if what it finds is this close to a whole number; and if the curvature next to the gap
changes the straight line's answer by less than this (half of a line's error by the third derivative)."""
_LEAST_ROWS, _AGREEING_SHARE = 5, 0.75
"""Least number of rows that vote, and share of them that must agree."""
_SAME = 0.1
"""Distance, periods, from the expected place or whole periods away, within which a node has not moved."""
_ORDERS = 8
"""Largest number of periods that is looked for."""
_UNKNOWN = _ORDERS + 1


@numba.njit(cache=True)
def _off_line(slope: Float, x: Float, valid: Mask, first: int, end: int) -> tuple[float, float]:
    """Difference of one row's slope beyond a gap from its straight continuation, and its error by curvature.

    The slope is taken to go on in a line from both sides to the gap's middle. Same unit as `slope`; NaN where
    three nodes on either side are not all known.
    """
    if end - first + 1 > _MOST_NODES or first < 3 or end > len(valid) - 3:
        return np.nan, np.nan
    if not (valid[first - 3 : first].all() and valid[end : end + 3].all()):
        return np.nan, np.nan
    a, b = slope[first - 3 : first], slope[end : end + 3]
    half = 0.5 * (x[end] - x[first - 1])
    before, after = half / (x[first - 1] - x[first - 3]), half / (x[end + 2] - x[end])
    off = b[0] - a[2] - before * (a[2] - a[0]) - after * (b[2] - b[0])
    return off, 2 * before * (a[2] - 2 * a[1] + a[0]) - 2 * after * (b[2] - 2 * b[1] + b[0])


@numba.njit(cache=True)
def _votes(slope: Float, x: Float, valid: Mask, seams: Ints, votes: Ints) -> None:
    """Count in `votes` (seams + 1, orders) the rows by the periods that each seam's far side is off."""
    for j in range(valid.shape[0]):
        i = 0
        while i < valid.shape[1]:
            end, seam = gap_end(valid[j], seams[j], i)
            if seam > 0:
                off, bent = _off_line(slope[j], x[j], valid[j], i, end)
                order = np.rint(off)
                if abs(off - order) < _CLEAR and abs(bent) < _BENT and abs(order) <= _ORDERS:
                    votes[seam, int(order) + _ORDERS] += 1
            i = end + 1


@numba.njit(cache=True)
def _join(slope: Float, x: Float, valid: Mask, seams: Ints, orders: Ints, out: Mask) -> None:
    """Mark in `out` the nodes of seams of order 0 over which a row's slope goes on in a straight line."""
    for j in range(valid.shape[0]):
        i = 0
        while i < valid.shape[1]:
            end, seam = gap_end(valid[j], seams[j], i)
            if seam > 0 and orders[seam] == 0:
                out[j, i:end] = abs(_off_line(slope[j], x[j], valid[j], i, end)[0]) < 0.5
            i = end + 1


@numba.njit(cache=True)
def _added_up(seams: Ints, orders: Ints) -> Ints:
    """Periods (rows, cols) by which nodes are off: sums of the orders of all seams before them in a row."""
    out = np.zeros(seams.shape, np.int64)
    for j in range(seams.shape[0]):
        total, before = 0, 0
        for i in range(seams.shape[1]):
            seam = seams[j, i]
            if seam != before and seam > 0:
                total += orders[seam] if orders[seam] != _UNKNOWN else 0
            out[j, i] = total
            before = seam
    return out


class _Rows:
    """Slopes of the mirror and seams at the measurable nodes of one frame.

    slopes: (2, rows, cols) in the slope that moves the picture by one period, so that an error of the order
    changes them by whole numbers although rays on the two sides of a seam differ in length. seams: (rows,
    cols) number of the seam, 0 for none. orders: (2, seams + 1) periods by which nodes beyond each seam are
    off; `_UNKNOWN` where rows do not agree.
    """

    def __init__(self, q: Float, flags: Flags, rest: Rest, seams: SeamMap) -> None:
        inner, grid = rest.grid.inner, rest.grid
        seam = rest.flags[inner] & np.uint16(Flag.SEAM) != 0
        count, numbers = cv2.connectedComponents(seam.astype(np.uint8))
        self.seams: Ints = numbers.astype(np.int64)
        self.valid: Mask = (flags[inner] == 0) & ~seam
        steps = np.stack([np.gradient(rest.q, axis=k) for k in (1, 0)], axis=-1)[inner]
        period = np.median((seams.slope_per_px @ steps)[rest.visible[inner]], axis=0)
        per_slope = np.linalg.inv(grid.period_px / grid.spacing_px * period)
        self.slopes: Float = np.einsum(
            "ab,...bc,...c->a...", per_slope, seams.slope_per_px, (q - rest.q)[inner]
        )
        self.x_mm = seams.x_mm
        votes = np.zeros((2, count, 2 * _ORDERS + 1), np.int64)
        for slope, of_axis in zip(self.slopes, votes, strict=True):
            _votes(slope, self.x_mm, self.valid, self.seams, of_axis)
        total = votes.sum(axis=-1)
        known = (votes.max(axis=-1) >= _AGREEING_SHARE * total) & (total >= _LEAST_ROWS)
        self.orders: Ints = np.where(known, votes.argmax(axis=-1) - _ORDERS, _UNKNOWN)


def _off_expected(away: Float, valid: Mask, parts: Ints) -> tuple[Ints, Mask]:
    """Periods (parts,) by which most nodes of each part differ from the expected; whether they agree.

    away: (rows, cols) periods from what was expected, NaN for nothing. parts: (rows, cols) by number.
    """
    order = np.rint(away)
    says = valid & (np.abs(away - order) < _SAME) & (np.abs(order) <= _ORDERS)
    size = np.bincount(parts[valid & np.isfinite(away)], minlength=parts.max() + 1)
    each = (2 * _ORDERS + 1) * parts[says] + order[says].astype(np.int64) + _ORDERS
    votes = np.bincount(each, minlength=len(size) * (2 * _ORDERS + 1)).reshape(len(size), -1)
    most: Ints = votes.argmax(axis=1) - _ORDERS
    return most, 2 * votes.max(axis=1) > np.maximum(size, _LEAST_ROWS)


def at_seams(q: Float, rest: Rest) -> Mask:
    """Nodes (rows, cols) whose window touches a saw's seam, at rest or where the mirror slopes now.

    q: (rows, cols, 2) LCD px where nodes look, finite everywhere.
    """
    seam: Mask = rest.flags & np.uint16(Flag.SEAM) != 0
    if rest.seams is not None:
        inner = rest.grid.inner
        seam[inner] |= rest.seams.moved((q - rest.q)[inner])
    return seam


def settle_order(
    residual: Residual, shown_q: Float, expected_px: Float, rest: Rest, blind: Mask | None = None
) -> None:
    """Bring `residual.d`, in place, to one order over all seams.

    Where the mirror has not moved, the order is that of expected_px (rows, cols, 2), camera px, NaN where
    nothing is expected. Otherwise it follows from the rows' votes, counted from the tooth that brings most
    nodes nearest to the null. blind: (rows, cols) nodes without a reading of their own, at seams or under the
    fringes of a burst; they cut teeth into pieces. None for none.
    """
    if rest.seams is None:
        return
    d, period_px = residual.d[rest.grid.inner], rest.grid.period_px
    q = compose(shown_q, residual.d, rest.grid.spacing_px)
    flags = residual.flags | rest.flags
    if blind is not None:
        flags[blind] |= np.uint16(Flag.CODED)
    rows = _Rows(q, flags, rest, rest.seams)
    pieces = cv2.connectedComponents(rows.valid.astype(np.uint8), connectivity=4)[1].astype(np.int64)
    teeth = _added_up(rows.seams, np.ones(rows.orders.shape[1], np.int64))
    away = (d - expected_px[rest.grid.inner]) / period_px
    for axis, orders in enumerate(rows.orders):
        by_tooth, still = _off_expected(away[..., axis], rows.valid, teeth)
        if still.all():
            by_piece, says = _off_expected(away[..., axis], rows.valid, pieces)
            d[..., axis] -= period_px * np.where(says[pieces], by_piece[pieces], by_tooth[teeth])
        elif (orders % _UNKNOWN != 0).any():
            off = _added_up(rows.seams, orders)
            periods, mine = d[rows.valid, axis] / period_px, off[rows.valid]
            near = {side: np.count_nonzero(np.abs(periods - mine + side) < 0.5) for side in np.unique(mine)}
            d[..., axis] -= period_px * (off - max(near, key=lambda side: near[side]))


def bridged(q: Float, flags: Flags, rest: Rest) -> Mask | None:
    """Nodes (rows, cols) at seams over which order is known; None of a prism. q: as measured, LCD px."""
    if rest.seams is None:
        return None
    rows = _Rows(q, flags, rest, rest.seams)
    out = np.zeros((2, *rows.valid.shape), bool)
    for slope, orders, joined in zip(rows.slopes, rows.orders, out, strict=True):
        _join(slope, rows.x_mm, rows.valid, rows.seams, orders, joined)
    return rest.grid.padded(out[0] & out[1], False)
