"""Coded strips at two edges of what the camera sees: which picture this is, written into the picture.

A strip is as high as a period (16 px at least) and lives in camera pixels like the target, drawn through the
same warp. Five bits lie along it: the Gray code (4 bits) of the count of presentations mod 16, and its parity
as a check, which flips at every step. So from one picture to the next exactly one bit and the check change.

Every bit is drawn as cells bit, not bit, not bit, bit. Their sum is the same whatever the bit, so brightness
needs no cells of its own; their symmetry takes out what changes linearly along the strip; and the strip's
mean light is the target's. White and black are the target's brightest and darkest light: what does not clip
the target does not clip the strips.

The strips lie at the two edges that see the panel's first and last rows: where both can be read, the scan-out
between them is measured, not assumed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.warp.grid import NodeGrid

CODES = 16
"""Codes are counts of presentations modulo this."""

BITS = 5
"""Four Gray-coded ones and the check."""

UNITS_PER_BIT = 4
"""Cells of a bit: bit, not bit, not bit, bit."""

LEAST_HEIGHT_PX = 16
LEAST_UNIT_PX = 8.0
"""A cell's inner half, 4 px, is beyond the blur of its neighbours."""

INNER_MARGIN_PX, OUTER_MARGIN_PX = 5, 1
"""Rows of a strip that are not read: where a press may pull in the target, and the image's edge."""

DEEPEST_SHARE = 0.25
"""A strip lies within this share of the view from its edge, or not at all."""


def bits_of(code: int) -> tuple[int, ...]:
    """Bits of a code 0..15: Gray code, lowest first, then the check."""
    gray = code ^ (code >> 1)
    return (*(gray >> k & 1 for k in range(BITS - 1)), code & 1)


@dataclass(frozen=True)
class Strip:
    """One strip. start_px, unit_px: where its first cell begins along the edge, a cell's width, camera px.

    edge_px: its inner edge across, camera px; it reaches from there outwards. read_px: first and last + 1 of
    the pixels across that are read. panel_rows: (5,) LCD row that each bit is read in at rest.
    """

    start_px: float
    unit_px: float
    edge_px: float
    read_px: tuple[int, int]
    panel_rows: Float


@dataclass(frozen=True)
class Strips:
    """The two strips of a rig.

    along_u: they lie at the top and bottom of the image (v bounds them), else left and right (u does).
    first: the strip at v or u near 0; last: the one at the other end.

    Convention: (u, v) = (column, row), pixel centres at integers.
    """

    along_u: bool
    height_px: int
    first: Strip
    last: Strip

    @classmethod
    def of(cls, grid: NodeGrid, q_rest: Float, no_ray: Mask, size: tuple[int, int]) -> Strips | None:
        """Find room for the strips; None where the panel fills too little of an edge.

        q_rest: (rows, cols, 2) LCD px. no_ray: (rows, cols) nodes without a ray at rest. size: the panel's
        (columns, rows). The edges are those across which the panel's rows change most.
        """
        spans = [float(np.ptp(np.median(q_rest[..., 1], axis=axis))) for axis in (0, 1)]
        along_u = spans[1] >= spans[0]
        inside = ~no_ray & (q_rest >= 0).all(axis=-1) & (q_rest <= np.array(size) - 1).all(axis=-1)
        lit, panel_row = (inside, q_rest[..., 1]) if along_u else (inside.T, q_rest[..., 1].T)
        across_px, along_px = (grid.v_px, grid.u_px) if along_u else (grid.u_px, grid.v_px)
        depth_px, length_px = grid.image_shape if along_u else grid.image_shape[::-1]
        height = max(grid.period_px, LEAST_HEIGHT_PX)
        found = [
            _place(lit, panel_row, across_px, along_px, depth_px, length_px, height, at_end)
            for at_end in (False, True)
        ]
        first, last = found
        return cls(along_u, height, first, last) if first and last else None

    def covered(self, grid: NodeGrid) -> Mask:
        """(rows, cols) nodes whose sensing window, +-(period - 1) px, touches a strip or lies beyond one."""
        reach = grid.period_px - 1
        across = grid.v_px if self.along_u else grid.u_px
        touched = (across - reach < self.first.edge_px) | (across + reach > self.last.edge_px)
        return np.broadcast_to(touched[:, None] if self.along_u else touched, grid.shape)


def _place(
    lit: Mask,
    panel_row: Float,
    across_px: Float,
    along_px: Float,
    depth_px: int,
    length_px: int,
    height_px: int,
    at_end: bool,
) -> Strip | None:
    """Outermost place, a node's spacing at a time, where the panel is visible over enough of the edge."""
    step = along_px[1] - along_px[0]
    along = (along_px >= 0) & (along_px <= length_px - 1)
    for shift in np.arange(0, DEEPEST_SHARE * depth_px, step):
        low = depth_px - shift - height_px if at_end else shift
        band = (across_px > low - step) & (across_px < low + height_px - 1 + step)
        band &= (across_px > -step) & (across_px < depth_px - 1 + step)
        begin, stop = _longest_run(lit[band].all(axis=0) & along)
        if stop == begin:
            continue
        # an edge of the image, where the panel reaches it, else the last node that sees the panel
        start_px = -0.5 if along_px[begin] - step < 0 else float(along_px[begin])
        end_px = length_px - 0.5 if along_px[stop - 1] + step > length_px - 1 else float(along_px[stop - 1])
        unit_px = (end_px - start_px) / (BITS * UNITS_PER_BIT)
        if unit_px < LEAST_UNIT_PX:
            continue
        middles = start_px + UNITS_PER_BIT * unit_px * (np.arange(BITS) + 0.5)
        margins = (INNER_MARGIN_PX, OUTER_MARGIN_PX) if at_end else (OUTER_MARGIN_PX, INNER_MARGIN_PX)
        read = int(low) + margins[0], int(low) + height_px - margins[1]
        middle = 0.5 * (read[0] + read[1] - 1)
        line = np.array([np.interp(middle, across_px, column) for column in panel_row.T])
        edge_px = low - 0.5 if at_end else low + height_px - 0.5
        return Strip(start_px, unit_px, float(edge_px), read, np.interp(middles, along_px, line))
    return None


def _longest_run(flags: Mask) -> tuple[int, int]:
    """Begin and stop of the longest run of True; (0, 0) where there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if not len(edges):
        return 0, 0
    begins, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - begins))
    return int(begins[longest]), int(stops[longest])
