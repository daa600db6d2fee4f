"""Slope at the seams of a saw (`zeromethod.warp.seams`), carried across from the nodes on both sides.

A node whose sensing window touches a seam mixes the pictures of two teeth, and its reading is not used. The
slope there is that of a polynomial along the node's row, through nodes on both sides. Its difference from a
polynomial of lower degree goes into sigma: of slope, and of depth as one error common to all nodes, since a
seam hides the same in all rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.optics import Optics
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.rays import MirrorRays
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.runs import runs
from zeromethod.warp.seams import SeamMap
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_SIDE = 5
"""Nodes on either side that the polynomial goes through."""
_MOST_DARK = 6
"""Unmeasured nodes next to a seam that count as part of it, at most."""
_DEGREE, _LOWER = 5, 3
"""Degree of the polynomial, and of the lower one that it is compared with."""
_KINKED = 2.3
"""True error over the difference of the two degrees, where a seam hides the rim of a ball's contact: median
of the depth across the seam; 5 in one case of a hundred. For smooth dents it is 0.6 at most."""
_LOOKS = 6
"""Iterations from a slope to the LCD position that it looks at, by the sensitivity at rest: a deep dent
changes that by a sixth, so that each leaves a sixth of the error."""
_STEPS_SHARE = 1.5e-4
"""Standard deviation of further errors by seams, over the range of depth: with exact warps of dents of sigma
1.5 to 8 mm, one node in 2000 is off by 0.045 % of the peak more than the two degrees differ by."""
PASSES = False, True
"""Slope is carried twice: at depth 0, then at the depth that this gave. Whether each is the last time."""


def _polynomials(t: Float) -> tuple[Float, Float]:
    """Weights (n, nodes) of values at `t` (n, nodes) in their polynomial at 0, and in a lower one."""
    basis: list[tuple[Float, Float]] = []
    weights = [np.zeros(t.shape)]
    one, value = np.ones(t.shape), np.ones(t.shape[1])
    for _ in range(_DEGREE + 1):
        # each is t times the one before, made orthogonal to all before: stable for any places
        for other, at_zero in basis:
            share = (one * other).sum(axis=0)
            one, value = one - share * other, value - share * at_zero
        size = np.sqrt((one * one).sum(axis=0))
        one, value = one / size, value / size
        basis.append((one, value))
        weights.append(weights[-1] + value * one)
        one, value = t * one, np.zeros(t.shape[1])
    return weights[_DEGREE + 1], weights[_LOWER + 1]


def _each(first: Ints, end: Ints) -> tuple[Ints, Ints]:
    """Number of the run, and column, of all nodes of runs, each (nodes,)."""
    run = np.repeat(np.arange(len(first)), end - first)
    before = np.cumsum(end - first) - (end - first)
    return run, np.arange(len(run)) + (first - before)[run]


def _gaps(good: Mask, seam: Mask) -> tuple[Ints, Ints, Ints]:
    """Row, first column and end of the gaps at seams, as `seam` (rows, cols) has them.

    A seam that opens is wider than a window says: nodes next to it that were not measured are its own.
    """
    row, first, end = runs(seam)
    column, cols = np.arange(seam.shape[1]), seam.shape[1]
    dark_from = np.maximum.accumulate(np.where(good, column + 1, 0), axis=1)
    dark_to = np.minimum.accumulate(np.where(good, column, cols)[:, ::-1], axis=1)[:, ::-1]
    start = np.maximum(dark_from[row, first], first - _MOST_DARK)
    end = np.minimum(dark_to[row, end - 1], end + _MOST_DARK)
    return row, start, end


def _carry(x: Float, slope: Float, good: Mask, seam: Mask) -> tuple[Float, Float, Float]:
    """Slopes (rows, cols, 2) carried to seams, their doubt, noise's gain; else NaN.

    The doubt has one sign at all nodes of a row's seam, that of what degrees differ by in depth across it.
    `seam` gets what belongs to seams besides.
    """
    out, doubt, gain = np.full(slope.shape, np.nan), np.full(slope.shape, np.nan), np.full(seam.shape, np.nan)
    row, start, end = _gaps(good, seam)
    run, column = _each(start, end)
    seam[row[run], column] = True
    inside = (start >= _SIDE) & (end + _SIDE <= seam.shape[1])
    row, start, end = row[inside], start[inside], end[inside]
    side = np.arange(_SIDE)
    at = np.concatenate([start[:, None] - _SIDE + side, end[:, None] + side], axis=1)
    whole = good[row[:, None], at].all(axis=1)
    row, start, end, at = row[whole], start[whole], end[whole], at[whole]
    run, column = _each(start, end)
    nodes = row[run], column
    high, low = _polynomials((x[row[:, None], at][run] - x[nodes][:, None]).T)
    known = slope[row[:, None], at][run]
    value, lower = (np.einsum("kn,nka->na", one, known) for one in (high, low))
    across = np.stack([np.bincount(run, one, len(row)) for one in (value - lower).T], axis=1)
    out[nodes], gain[nodes] = value, np.sqrt((high * high).sum(axis=0))
    doubt[nodes] = _KINKED * np.abs(value - lower) * np.where(across < 0.0, -1.0, 1.0)[run]
    return out, doubt, gain


def _spread(x: Float, seam: Mask) -> Float:
    """What spreads points at seams evenly between those next to the seam (rows, cols), mm."""
    out = np.zeros(x.shape)
    row, first, end = runs(seam)
    inside = (first > 1) & (end < seam.shape[1] - 1)
    row, first, end = row[inside], first[inside], end[inside]
    step = 0.5 * (x[row, first - 1] - x[row, first - 2] + x[row, end + 1] - x[row, end])
    extra = x[row, end] - x[row, first - 1] - (end - first + 1) * step
    run, column = _each(first, end)
    n = column - first[run] + 1
    t = n / (end - first + 1)[run]
    # smooth at both ends, as what is integrated over the nodes has to be
    smooth = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    nodes = row[run], column
    out[nodes] = (x[row, first - 1])[run] + n * step[run] + extra[run] * smooth - x[nodes]
    return out


def _last_known(values: Float) -> Float:
    """Values (rows, cols) with NaN replaced by the last known before it in its row; 0 where there is none."""
    known = ~np.isnan(values)
    at = np.maximum.accumulate(np.where(known, np.arange(values.shape[1]), 0), axis=1)
    return np.nan_to_num(np.take_along_axis(values, at, axis=1), nan=0.0, posinf=np.inf, neginf=-np.inf)


@dataclass(frozen=True, slots=True)
class Carried:
    """A warp whose nodes at seams have the slope carried across.

    nodes: (rows, cols) at seams, of the whole grid. doubt: (rows, cols, 2) rad, error of one sigma of the
    slope there, with its sign, of the measurable nodes; 0 off seams.
    """

    warp: Warp
    nodes: Mask
    doubt: Float

    def errors_mm(
        self, depth_mm: Float, linear: LinearIntegration, anchor: Float, scale: Float
    ) -> list[Float]:
        """Independent errors (rows, cols) of depth, one sigma of each: further ones, and that by `doubt`.

        anchor: weights (rows, cols); scale: h (rows, cols).
        """
        deep = depth_mm[linear.island]
        left = np.full(depth_mm.shape, _STEPS_SHARE * float(np.ptp(deep)) if deep.size else 0.0)
        else_mm = linear.depth(self.doubt)
        return [left, scale * (else_mm - float((anchor * else_mm).sum()))]


class SlopeOverSeams:
    """Carries slopes across the seams of a rig's saw, on the measurable nodes of a grid.

    shift_mm: (rows, cols) by which rays of nodes at seams are moved along x, so that what lies behind a seam,
    which no ray sees, has nodes as well.
    """

    def __init__(self, seams: SeamMap, grid: NodeGrid) -> None:
        self._map, self._grid = seams, grid
        self.at_rest = seams.touched(np.zeros(seams.x_mm.shape))
        """(rows, cols) nodes at seams of the mirror at rest."""
        self.shift_mm = _spread(seams.x_mm, self.at_rest)

    @classmethod
    def of(cls, optics: Optics, grid: NodeGrid) -> SlopeOverSeams | None:
        """Those of a rig; None of a prism."""
        seams = SeamMap.of(optics, grid)
        return None if seams is None else cls(seams, grid)

    def set_rays(self, rays: MirrorRays, sensitivity: Float) -> None:
        """Take the nodes' rays, moved by `shift_mm`, and LCD px per rad at rest, before `carried`."""
        self._rays, self._sensitivity = rays, sensitivity

    def carried(self, warp: Warp, depth_mm: Float) -> Carried:
        """Carry the slope across seams.

        depth_mm: (rows, cols) of the measurable nodes, as far as it is known. Where a neighbour is missing
        (at the view's border, a contact) a node at a seam is flagged SEAM.
        """
        inner = self._grid.inner
        q, sigma, flags = warp.q.copy(), warp.sigma.copy(), warp.flags.copy()
        slope, point = self._rays.slope(depth_mm, q[inner])
        good = (flags[inner] == 0) & np.isfinite(slope).all(axis=-1)
        # a seam that a slope moves is dark: the slope there is that of the nodes next to it, on either side
        of_x = np.where(good, slope[..., 0], np.nan)
        before, after = _last_known(of_x), _last_known(of_x[:, ::-1])[:, ::-1]
        depth_mm = np.where(np.isfinite(depth_mm), depth_mm, 0.0)
        seam = self._map.touched(before, depth_mm) | self._map.touched(after, depth_mm)
        good &= ~seam
        out, doubt, gain = _carry(point[..., 0], slope, good, seam)
        known = np.isfinite(gain)
        noise = float(np.median(sigma[inner][good])) if good.any() else np.nan
        carried = self._rays.rest_q + _times(self._sensitivity, out)
        for _ in range(_LOOKS):
            carried += _times(self._sensitivity, out - self._rays.slope(depth_mm, carried)[0])
        doubted = _times(np.abs(self._sensitivity), np.abs(doubt))
        q[inner] = np.where(seam[..., None], carried, q[inner])
        sigma[inner] = np.where(seam[..., None], np.hypot(gain[..., None] * noise, doubted), sigma[inner])
        flags[inner] = np.where(known, 0, np.where(seam, flags[inner] | np.uint16(Flag.SEAM), flags[inner]))
        carried_warp = replace(warp, q=q, sigma=sigma, flags=flags)
        return Carried(carried_warp, self._grid.padded(seam, False), np.nan_to_num(doubt))


def _times(matrix: Float, vector: Float) -> Float:
    """(..., 2, 2) by (..., 2)."""
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))
