"""Camera rays inside the rubber, and the mirror's slope from a depth and an LCD position."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
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


@numba.njit(cache=True, error_model="numpy")
def _go_on(start: Float, way: Float, by: Float, out: Float) -> None:
    """Points (3, rows, cols) `by` (rows, cols) times the way from the start."""
    for k in range(len(out)):
        for i in range(out.shape[1]):
            for j in range(out.shape[2]):
                out[k, i, j] = start[k, i, j] + by[i, j] * way[k, i, j]


@numba.njit(cache=True, error_model="numpy")
def _add(by: Float, rate: Float, out: Float) -> None:
    """Add `by` (n,) times a rate (n,); a rate of NaN changes nothing where `by` is 0."""
    for k in range(len(out)):
        out[k] += by[k] * rate[k] if by[k] != 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _twice(by: Float, away: Float, rate_x: Float, rate_y: Float) -> float:
    """Mean, where `by` (n,) is not 0, of the square of what slope has turned by twice."""
    total, count = 0.0, 0
    for k in range(len(by)):
        there = by[k] != 0.0
        turned2 = (rate_x[k] * rate_x[k] + rate_y[k] * rate_y[k]) * away[k] * away[k]
        total += turned2 * turned2 if there else 0.0
        count += there
    return total / max(count, 1)


@numba.njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _largest(by: Float) -> float:
    """Largest size of finite values (n,)."""
    largest = 0.0
    for k in range(len(by)):
        size = abs(by[k])
        largest = size if size > largest else largest
    return largest


@numba.njit(cache=True, error_model="numpy")
def _move(
    by: Float, traced: Float, depth: Float, rate: Float, way: Float, slope: Float, point: Float
) -> tuple[float, float]:
    """Add to depth (rows, cols), and what follows to slopes (2, rows, cols) and points (3, ...).

    The largest step; the root mean square of what slope has turned by twice, which is the next order.
    """
    n = by.size
    step, away, started = by.reshape(n), np.empty(n), traced.reshape(n)
    rates, ways = rate.reshape(2, n), way.reshape(3, n)
    deep, slopes, points = depth.reshape(n), slope.reshape(2, n), point.reshape(3, n)
    for k in range(n):
        deep[k] += step[k]
        away[k] = deep[k] - started[k]
    for axis in range(2):
        _add(step, rates[axis], slopes[axis])
    for axis in range(3):
        _add(step, ways[axis], points[axis])
    return _largest(step), np.sqrt(_twice(step, away, rates[0], rates[1]))


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
        fields = self.traced, self.depth, self.rate, self.way, self.slope, self.point
        step_mm, turned = _move(by_mm, *fields)
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
        point = np.empty(self._rest_point.shape)
        _go_on(self._rest_point, self._way_per_depth, depth_mm, point)
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
