"""Camera rays inside the rubber, and the mirror's slope from a depth and an LCD position."""

from __future__ import annotations

import math
from copy import copy
from typing import Any, NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.kernels import kernel, read
from zeromethod.optics import Flat, Optics
from zeromethod.optics.saw_rays import exit_tooth
from zeromethod.surface.node_passes import diagonal

_STEPS = 20
_SETTLED_MM = 1e-12
_CURVED = 0.25
"""Error of a depth whose rays were followed, over the view's extent and what their slopes turned by twice:
0.04 to 0.24 for a shift or a swell of the dent, a tilt, and a constant."""
_PROBE_MM = 1e-3
"""Step along a ray by which the change of the rest surface's slope is found."""


_LINE, _LINES = read(numba.float64, 1), read(numba.float64, 2)


@kernel(
    _LINE, _LINE, _LINES, _LINES, numba.float64[::1], numba.float64[:, ::1], numba.float64[:, ::1],
    fastmath={"contract", "reassoc", "nsz"},
)  # fmt: skip
def _move(by: Any, traced: Any, rate: Any, way: Any, depth: Any, slope: Any, point: Any) -> float:
    """Add `by` (n,) to depth, and what follows to slopes (2, n) and points (3, n).

    A rate or way of NaN changes nothing where `by` is 0. Root mean square, where it is not, of what slope has
    turned by twice, which is the next order.
    """
    total, count = 0.0, 0
    for k in range(len(by)):
        depth[k] += by[k]
        away, there = depth[k] - traced[k], by[k] != 0.0
        turned2 = (rate[0, k] * rate[0, k] + rate[1, k] * rate[1, k]) * away * away
        total += turned2 * turned2 if there else 0.0
        count += there
    for axis in range(2):
        for k in range(len(by)):
            slope[axis, k] += by[k] * rate[axis, k] if by[k] != 0.0 else 0.0
    for axis in range(3):
        for k in range(len(by)):
            point[axis, k] += by[k] * way[axis, k] if by[k] != 0.0 else 0.0
    return math.sqrt(total / max(count, 1))


class Look(NamedTuple):
    """Slope and points of a depth that looks at LCD positions: traced at one depth, followed to first order.

    traced, depth: (rows, cols) mm. slope, rate: (2, rows, cols) rad, and what it changes by, rad/mm. point,
    way: (3, rows, cols) the same, mm. NaN where no ray joins the two. extent_mm: of the view.
    """

    traced: Float
    depth: Float
    slope: Float
    rate: Float
    point: Float
    way: Float
    extent_mm: float

    def move(self, by_mm: Float) -> tuple[float, float]:
        """Add to the depth (rows, cols); its largest step, and what following costs the depth's shape, mm."""
        n = by_mm.size
        rate, way, slope, point = (
            one.reshape(len(one), n) for one in (self.rate, self.way, self.slope, self.point)
        )
        turned = _move(by_mm.ravel(), self.traced.ravel(), rate, way, self.depth.reshape(n), slope, point)
        step_mm = float(np.fmax.reduce(np.abs(by_mm), axis=None, initial=0.0))
        return step_mm, _CURVED * self.extent_mm * turned


class MirrorRays:
    """Fixed rays of a set of camera pixels, from the camera face towards the mirror.

    Convention: depth belongs to the pixel: its mirror point lies on its ray at height
    z = h_rest(x, y) - depth. Points and slopes are NaN where the ray misses the mirror at rest.
    """

    def __init__(self, optics: Optics, u_px: Float, v_px: Float, shift_mm: Float | float = 0.0) -> None:
        """shift_mm: (...) by which rays are moved along x in the rubber (`seams`)."""
        self._rest = optics.rest
        self._joinings = optics.joinings
        origin, direction = optics.rubber_rays(u_px, v_px)
        origin[..., 0] += shift_mm
        self.rubber = origin, direction
        self._tooth = exit_tooth(optics, origin, direction)
        at_rest = optics.trace_rays(origin, direction, optics.rest)
        self.rest_q: Float = at_rest.q
        hits = np.asarray(np.isfinite(at_rest.q).all(axis=-1))
        self._direction, self._rest_point = (
            np.ascontiguousarray(np.where(hits, np.moveaxis(one, -1, 0), np.nan))
            for one in (direction, at_rest.point)
        )
        x, y, _ = self._rest_point
        self._extent_mm = diagonal(x, y, hits) if hits.any() else 0.0
        gx, gy = self._rest.gradient(*self._rest_point[:2])
        # change of depth below the rest surface per mm along the ray
        rise = direction[..., 2] - gx * direction[..., 0] - gy * direction[..., 1]
        self._way_per_depth = np.where(hits, -1.0 / rise, np.nan) * self._direction
        self.hits: Mask = hits & np.asarray(np.isfinite(origin).all(axis=-1))

    def part(self, box: tuple[slice, ...]) -> MirrorRays:
        """Those of a box of rows and columns."""
        part = copy(self)
        part.rest_q, part.hits, part._tooth = self.rest_q[box], self.hits[box], self._tooth[box]
        part._direction, part._rest_point, part._way_per_depth = (
            np.ascontiguousarray(one[:, *box])
            for one in (self._direction, self._rest_point, self._way_per_depth)
        )
        return part

    def _points(self, depth_mm: Float) -> Float:
        """Mirror points (3, rows, cols) in mm at the given depths (rows, cols)."""
        direction, rest = self._direction, self._rest
        point: Float = self._way_per_depth * depth_mm
        point += self._rest_point
        if isinstance(rest, Flat):
            return point
        for _ in range(_STEPS):
            x, y, z = point
            gx, gy = rest.gradient(x, y)
            above = z - (rest.height(x, y) - depth_mm)
            step = -above / (direction[2] - gx * direction[0] - gy * direction[1])
            point = point + step * direction
            if not np.any(np.abs(step) > _SETTLED_MM):
                break
        return point

    def look(self, depth_mm: Float, q: Float) -> Look:
        """At points at these depths (rows, cols) that look at `q` (rows, cols, 2) LCD px."""
        point, way, rest = self._points(depth_mm), self._way_per_depth, self._rest
        if isinstance(rest, Flat):
            slope, rate = np.zeros((2, 2, *depth_mm.shape))
        else:
            slope = np.stack(rest.gradient(point[0], point[1]))
            ahead = point[:2] + _PROBE_MM * way[:2]
            rate = (np.stack(rest.gradient(*ahead)) - slope) / _PROBE_MM
        looked_at = np.ascontiguousarray(np.moveaxis(q, -1, 0))
        fields = self._direction, point, looked_at, way, slope, rate
        self._join([one.reshape(len(one), -1) for one in fields])
        return Look(depth_mm, depth_mm.copy(), slope, rate, point, way, self._extent_mm)

    def _join(self, fields: list[Float]) -> None:
        """Add what `Joining.add_slope` finds, tooth by tooth; a prism is one."""
        if len(self._joinings) == 1:
            self._joinings[0].add_slope(*fields)
            return
        for tooth in np.unique(self._tooth):
            nodes = np.flatnonzero(self._tooth == tooth)
            part = [np.ascontiguousarray(field[:, nodes]) for field in fields]
            self._joinings[tooth].add_slope(*part)
            fields[4][:, nodes], fields[5][:, nodes] = part[4:]

    def slope(self, depth_mm: Float, q: Float) -> tuple[Float, Float]:
        """Slope of depth (rows, cols, 2) at points (rows, cols, 3), of `look`.

        The last axis of the results is the slowest in memory.
        """
        found = self.look(depth_mm, q)
        return np.moveaxis(found.slope, 0, -1), np.moveaxis(found.point, 0, -1)
