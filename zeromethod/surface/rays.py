"""Camera rays inside the rubber, and the mirror's slope from a depth and an LCD position."""

from __future__ import annotations

from copy import copy

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Flat, Optics

_STEPS = 20
_SETTLED_MM = 1e-12


@numba.njit(cache=True, error_model="numpy")
def _go_on(start: Float, way: Float, by: Float, out: Float) -> None:
    """Points (3, rows, cols) `by` (rows, cols) times the way from the start."""
    for k in range(len(out)):
        for i in range(out.shape[1]):
            for j in range(out.shape[2]):
                out[k, i, j] = start[k, i, j] + by[i, j] * way[k, i, j]


class MirrorRays:
    """Fixed rays of a set of camera pixels, from the camera face towards the mirror.

    Convention: depth belongs to the pixel: its mirror point lies on its ray at height
    z = h_rest(x, y) - depth. Points and slopes are NaN where the ray misses the mirror at rest.
    """

    def __init__(self, optics: Optics, u_px: Float, v_px: Float) -> None:
        self._rest = optics.rest
        self._joining = optics.joining
        at_rest = optics.trace(u_px, v_px, optics.rest)
        self.rest_q: Float = at_rest.q
        hits = np.asarray(np.isfinite(at_rest.q).all(axis=-1))
        origin, direction = optics.rubber_rays(u_px, v_px)
        self._direction = np.where(hits, np.moveaxis(direction, -1, 0), np.nan)
        self._rest_point = np.where(hits, np.moveaxis(at_rest.point, -1, 0), np.nan)
        gx, gy = self._rest.gradient(*self._rest_point[:2])
        # change of depth below the rest surface per mm along the ray
        rise = direction[..., 2] - gx * direction[..., 0] - gy * direction[..., 1]
        self._way_per_depth = np.where(hits, -1.0 / rise, np.nan) * self._direction
        self.hits: Mask = hits & np.asarray(np.isfinite(origin).all(axis=-1))

    def part(self, box: tuple[slice, ...]) -> MirrorRays:
        """Those of a box of rows and columns."""
        part = copy(self)
        part.rest_q, part.hits = self.rest_q[box], self.hits[box]
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

    def slope(self, depth_mm: Float, q: Float) -> tuple[Float, Float]:
        """Slope of depth (rows, cols, 2) at points (rows, cols, 3) at these depths that look at `q`.

        q: (rows, cols, 2) LCD px. NaN where no ray joins point and LCD position. The last axis of the results
        is the slowest in memory.
        """
        point = self._points(depth_mm)
        slope = np.stack(self._rest.gradient(point[0], point[1]))
        looked_at = np.ascontiguousarray(np.moveaxis(q, -1, 0))
        self._joining.add_slope(
            *(one.reshape(len(one), -1) for one in (self._direction, point, looked_at, slope))
        )
        return np.moveaxis(slope, 0, -1), np.moveaxis(point, 0, -1)
