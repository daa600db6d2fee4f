"""Slope at the seams of a saw (`zeromethod.warp.seams`), carried across from the nodes on both sides.

A node whose sensing window touches a seam mixes the pictures of two teeth, and its reading is not used. The
slope there is that of a polynomial along the node's row, through nodes on both sides. Its difference from a
polynomial of lower degree goes into sigma: of slope, and of depth as one error common to all nodes, since a
seam hides the same in all rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.optics import Optics
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.rays import MirrorRays
from zeromethod.warp.grid import NodeGrid
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


@numba.njit(cache=True, error_model="numpy")
def _polynomial(t: Float, weight: Float, degree: int) -> None:
    """Into `weight` (n,) the weights of values at `t` (n,) in their polynomial's value at 0."""
    n = len(t)
    basis = np.empty((degree + 1, n))
    at_zero = np.empty(degree + 1)
    weight[:] = 0.0
    for k in range(degree + 1):
        # each is t times the one before, made orthogonal to all before: stable for any places
        for i in range(n):
            basis[k, i] = 1.0 if k == 0 else t[i] * basis[k - 1, i]
        value = 1.0 if k == 0 else 0.0
        for other in range(k):
            share = 0.0
            for i in range(n):
                share += basis[k, i] * basis[other, i]
            for i in range(n):
                basis[k, i] -= share * basis[other, i]
            value -= share * at_zero[other]
        size = np.sqrt((basis[k] * basis[k]).sum())
        basis[k] /= size
        at_zero[k] = value / size
        for i in range(n):
            weight[i] += at_zero[k] * basis[k, i]


@numba.njit(cache=True)
def _run_end(seam: Mask, first: int) -> int:
    """Column of one row at which the nodes at a seam, from `first` on, end."""
    end = first
    while end < len(seam) and seam[end]:
        end += 1
    return end


@numba.njit(cache=True)
def _ends(good: Mask, seam: Mask, first: int) -> tuple[int, int]:
    """From, to of the columns of one row that belong to the seam at `first`.

    A seam that opens is wider than a window says: nodes next to it that were not measured are its own.
    """
    start, end, cols = first, _run_end(seam, first), len(seam)
    least, most = max(start - _MOST_DARK, 0), min(end + _MOST_DARK, cols)
    while start > least and not good[start - 1]:
        start -= 1
    while end < most and not good[end]:
        end += 1
    return start, end


@numba.njit(cache=True)
def _sides(good: Mask, start: int, end: int, at: Ints) -> bool:
    """Columns of one row by which a seam's slope is carried; whether all of them were measured."""
    whole = start >= _SIDE and end + _SIDE <= len(good)
    for k in range(_SIDE):
        at[k], at[_SIDE + k] = start - _SIDE + k, end + k
        whole = whole and good[at[k]] and good[at[_SIDE + k]]
    return whole


@numba.njit(cache=True, error_model="numpy")
def _carry(x: Float, slope: Float, good: Mask, seam: Mask, out: Float, doubt: Float, gain: Float) -> None:
    """Slopes (rows, cols, 2) carried to seams, their doubt, noise's gain; else NaN.

    The doubt has one sign at all nodes of a row's seam, that of what degrees differ by in depth across it.
    `seam` gets what belongs to seams besides.
    """
    rows, cols = seam.shape
    at, t = np.empty(2 * _SIDE, np.int64), np.empty(2 * _SIDE)
    high, low = np.empty(2 * _SIDE), np.empty(2 * _SIDE)
    across = np.empty(2)
    out[:], doubt[:], gain[:] = np.nan, np.nan, np.nan
    for j in range(rows):
        i = 0
        while i < cols:
            if not seam[j, i]:
                i += 1
                continue
            start, end = _ends(good[j], seam[j], i)
            seam[j, start:end] = True
            i = end
            if not _sides(good[j], start, end, at):
                continue
            across[:] = 0.0
            for node in range(start, end):
                for k in range(2 * _SIDE):
                    t[k] = x[j, at[k]] - x[j, node]
                _polynomial(t, high, _DEGREE)
                _polynomial(t, low, _LOWER)
                gain[j, node] = np.sqrt((high * high).sum())
                for axis in range(2):
                    value, lower = 0.0, 0.0
                    for k in range(2 * _SIDE):
                        value += high[k] * slope[j, at[k], axis]
                        lower += low[k] * slope[j, at[k], axis]
                    out[j, node, axis] = value
                    doubt[j, node, axis] = _KINKED * abs(value - lower)
                    across[axis] += value - lower
            for axis in range(2):
                if across[axis] < 0.0:
                    doubt[j, start:end, axis] *= -1.0


@numba.njit(cache=True, error_model="numpy")
def _spread(x: Float, seam: Mask, out: Float) -> None:
    """Into `out` (rows, cols) what spreads points at seams evenly between those next to the seam, mm."""
    rows, cols = seam.shape
    out[:] = 0.0
    for j in range(rows):
        i = 0
        while i < cols:
            if not seam[j, i]:
                i += 1
                continue
            end = _run_end(seam[j], i)
            if i > 1 and end < cols - 1:
                step = 0.5 * (x[j, i - 1] - x[j, i - 2] + x[j, end + 1] - x[j, end])
                extra = x[j, end] - x[j, i - 1] - (end - i + 1) * step
                for k in range(i, end):
                    n = k - i + 1
                    t = n / (end - i + 1)
                    # smooth at both ends, as what is integrated over the nodes has to be
                    smooth = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
                    out[j, k] = x[j, i - 1] + n * step + extra * smooth - x[j, k]
            i = end


@numba.njit(cache=True)
def _beside(values: Float) -> tuple[Float, Float]:
    """Values (rows, cols) with NaN replaced by the last known before it in its row, and by the next after it.

    0 where there is none.
    """
    rows, cols = values.shape
    before, after = np.empty((rows, cols)), np.empty((rows, cols))
    for j in range(rows):
        last, following = 0.0, 0.0
        for i in range(cols):
            last = last if np.isnan(values[j, i]) else values[j, i]
            before[j, i] = last
            k = cols - 1 - i
            following = following if np.isnan(values[j, k]) else values[j, k]
            after[j, k] = following
    return before, after


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
        self.shift_mm = np.zeros(seams.x_mm.shape)
        self.at_rest = seams.touched(self.shift_mm)
        """(rows, cols) nodes at seams of the mirror at rest."""
        _spread(seams.x_mm, self.at_rest.copy(), self.shift_mm)

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
        slope, point = map(np.ascontiguousarray, self._rays.slope(depth_mm, q[inner]))
        good = (flags[inner] == 0) & np.isfinite(slope).all(axis=-1)
        # a seam that a slope moves is dark: the slope there is that of the nodes next to it, on either side
        before, after = _beside(np.where(good, slope[..., 0], np.nan))
        depth_mm = np.where(np.isfinite(depth_mm), depth_mm, 0.0)
        seam = self._map.touched(before, depth_mm) | self._map.touched(after, depth_mm)
        good &= ~seam
        out, doubt = np.empty((2, *slope.shape))
        gain = np.empty(seam.shape)
        _carry(point[..., 0].copy(), slope, good, seam, out, doubt, gain)
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
