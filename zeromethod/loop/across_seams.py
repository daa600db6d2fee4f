"""Order of the carrier across the seams of a saw, found from the mirror's slopes on both sides.

Elsewhere the order goes from node to node (`sensing.unwrap`). A node at a seam cannot pass it on, as its
window mixes the pictures of two teeth. But the mirror itself is continuous: its slope, continued along a row
in a straight line over the seam, differs from the slope read beyond it by whole periods. Each row with little
curvature votes for a number of periods, and most rows of a seam must agree.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Flags, Float, Ints, Mask
from zeromethod.sensing.residual import Residual
from zeromethod.warp.compose import compose
from zeromethod.warp.rest import Rest
from zeromethod.warp.seams import SeamMap, gaps
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


def _off_line(slope: Float, x: Float, valid: Mask, row: Ints, first: Ints, end: Ints) -> tuple[Float, Float]:
    """Difference of rows' slopes beyond gaps from their straight continuation, and its error by curvature.

    slope, x, valid: (rows, cols). row, first, end: (n,) as `gaps` has them. A slope is taken to go on in a
    line from both sides to the gap's middle. Same unit as `slope`; NaN where three nodes on either side are
    not all known.
    """
    fits = (end - first < _MOST_NODES) & (first >= 3) & (end <= valid.shape[1] - 3)
    three = np.arange(3)[:, None]
    before, after = (row, np.where(fits, first - 3, 0) + three), (row, np.where(fits, end, 0) + three)
    known = fits & valid[before].all(axis=0) & valid[after].all(axis=0)
    a, b = slope[before], slope[after]
    left, right = x[before], x[after]
    half = 0.5 * (right[0] - left[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        on, back = half / (left[2] - left[0]), half / (right[2] - right[0])
        off = b[0] - a[2] - on * (a[2] - a[0]) - back * (b[2] - b[0])
        bent = 2 * on * (a[2] - 2 * a[1] + a[0]) - 2 * back * (b[2] - 2 * b[1] + b[0])
    return np.where(known, off, np.nan), np.where(known, bent, np.nan)


def _votes(off: Float, bent: Float, seam: Ints, count: int) -> Ints:
    """(count, orders) gaps (n,) of each seam, by the periods that its far side is off."""
    order = np.rint(off)
    says = (np.abs(off - order) < _CLEAR) & (np.abs(bent) < _BENT) & (np.abs(order) <= _ORDERS)
    votes = np.zeros((count, 2 * _ORDERS + 1), np.int64)
    np.add.at(votes, (seam[says], order[says].astype(np.int64) + _ORDERS), 1)
    return votes


def _added_up(seams: Ints, orders: Ints) -> Ints:
    """Periods (rows, cols) by which nodes are off: sums of the orders of all seams before them in a row."""
    begins = np.diff(seams, axis=1, prepend=0) != 0
    known = np.where(orders == _UNKNOWN, 0, orders)
    known[0] = 0
    out: Ints = np.cumsum(begins * known[seams], axis=1)
    return out


class _Rows:
    """Slopes of the mirror over the seams among the measurable nodes of one frame.

    Slopes are in the slope that moves the picture by one period, so that an error of the order changes them
    by whole numbers although rays on the two sides of a seam differ in length. seams: (rows, cols) number of
    the seam, 0 for none. gaps: row, first column and that after the last (n,) of runs of nodes without a
    value at a seam, `of_gap` its number. off: (2, n) difference of slopes beyond them from a straight line.
    orders: (2, seams + 1) periods by which nodes beyond each seam are off; `_UNKNOWN` where rows disagree.
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
        slopes: Float = np.einsum("ab,...bc,...c->a...", per_slope, seams.slope_per_px, (q - rest.q)[inner])
        *self.gaps, self.of_gap = gaps(self.valid, self.seams)
        found = [_off_line(slope, seams.x_mm, self.valid, *self.gaps) for slope in slopes]
        self.off: Float = np.stack([off for off, _ in found])
        votes = np.stack([_votes(*one, self.of_gap, count) for one in found])
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
    row, first, end = rows.gaps
    joined = ((rows.orders[:, rows.of_gap] == 0) & (np.abs(rows.off) < 0.5)).all(axis=0)
    steps = np.zeros((rows.valid.shape[0], rows.valid.shape[1] + 1), np.int8)
    steps[row[joined], first[joined]] = 1
    steps[row[joined], end[joined]] = -1
    return rest.grid.padded(np.cumsum(steps, axis=1)[:, :-1] > 0, False)
