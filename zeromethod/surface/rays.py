"""Camera rays inside the rubber, and the mirror's slope from a depth and an LCD position."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Flat, Optics

_STEPS = 20
_SETTLED_MM = 1e-12


class MirrorRays:
    """Fixed rays of a set of camera pixels, from the camera face towards the mirror.

    Convention: depth belongs to the pixel: its mirror point lies on its ray at height
    z = h_rest(x, y) - depth. Points and slopes are NaN where the ray misses the mirror at rest.
    """

    def __init__(self, optics: Optics, u_px: Float, v_px: Float) -> None:
        self._optics = optics
        self._rest = optics.rest
        at_rest = optics.trace(u_px, v_px, optics.rest)
        self.rest_q: Float = at_rest.q
        hits = np.asarray(np.isfinite(at_rest.q).all(axis=-1))
        origin, direction = optics.rubber_rays(u_px, v_px)
        self._direction = np.where(hits[..., None], direction, np.nan)
        self._rest_point = np.where(hits[..., None], at_rest.point, np.nan)
        gx, gy = self._rest.gradient(self._rest_point[..., 0], self._rest_point[..., 1])
        # change of depth below the rest surface per mm along the ray
        rise = direction[..., 2] - gx * direction[..., 0] - gy * direction[..., 1]
        self._distance_per_depth = np.where(hits, -1.0 / rise, np.nan)
        self.hits: Mask = hits & np.asarray(np.isfinite(origin).all(axis=-1))

    def points(self, depth_mm: Float) -> Float:
        """Mirror points (rows, cols, 3) in mm at the given depths (rows, cols)."""
        direction, rest = self._direction, self._rest
        along = depth_mm * self._distance_per_depth
        point: Float = self._rest_point + along[..., None] * direction
        if isinstance(rest, Flat):
            return point
        for _ in range(_STEPS):
            x, y = point[..., 0], point[..., 1]
            gx, gy = rest.gradient(x, y)
            above = point[..., 2] - (rest.height(x, y) - depth_mm)
            step = -above / (direction[..., 2] - gx * direction[..., 0] - gy * direction[..., 1])
            point = point + step[..., None] * direction
            if not np.any(np.abs(step) > _SETTLED_MM):
                break
        return point

    def slope(self, depth_mm: Float, q: Float) -> tuple[Float, Float]:
        """Slope of depth (rows, cols, 2) at points (rows, cols, 3) at these depths that look at `q`.

        q: (rows, cols, 2) LCD px. NaN where no ray joins point and LCD position.
        """
        point = self.points(depth_mm)
        outgoing = self._optics.rubber_direction_to_lcd(point, q)
        normal = self._optics.normal_between(self._direction, outgoing)
        gradient = self._rest.gradient(point[..., 0], point[..., 1])
        slope = np.stack(gradient, axis=-1) + normal[..., :2] / normal[..., 2:]
        return slope, point
