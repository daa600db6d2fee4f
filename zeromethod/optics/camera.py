"""The camera's rays: pixel to ray in air, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.vectors import dot, unit
from zeromethod.rig.model import CameraSpec

Distortion = tuple[float, float, float, float, float]

_ITERATIONS, _TOLERANCE = 50, 1e-14
"""Most Newton steps, and the error, in focal lengths, that ends them: rounding."""


def distort(x: Float, y: Float, k: Distortion) -> tuple[Float, Float]:
    """Distorted normalised image coordinates of ideal ones, each (...).

    Source: OpenCV's pinhole model with (k1, k2, p1, p2, k3) (Brown 1971).
    """
    k1, k2, p1, p2, k3 = k
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def undistort(x_image: Float, y_image: Float, k: Distortion) -> tuple[Float, Float]:
    """Ideal normalised image coordinates of distorted ones, each (...): Newton to machine precision.

    NaN where the iteration does not settle (beyond the model's turning point).
    """
    x, y = x_image.copy(), y_image.copy()
    if not any(k):
        return x, y
    k1, k2, p1, p2, k3 = k
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            growth = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
            xx = radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            yy = radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            xy = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y
            x_now, y_now = distort(x, y, k)
            x_miss, y_miss = x_image - x_now, y_image - y_now
            determinant = xx * yy - xy * xy
            x = x + (yy * x_miss - xy * y_miss) / determinant
            y = y + (xx * y_miss - xy * x_miss) / determinant
            unsettled = np.hypot(x_miss, y_miss) > _TOLERANCE
            if not unsettled.any():
                break
    return np.where(unsettled, np.nan, x), np.where(unsettled, np.nan, y)


@dataclass(frozen=True)
class CameraModel:
    """Pose and projection of a rig's camera.

    Convention: `axis` points from `position` to the look-at point; with no roll v runs along world +y (its
    part across the axis) and u = v x axis; positive roll turns u towards v. All (3,), position in mm.
    """

    spec: CameraSpec
    position: Float
    axis: Float
    u_axis: Float
    v_axis: Float

    @classmethod
    def place(cls, spec: CameraSpec) -> CameraModel:
        """Camera of a rig; axes are NaN without viewing direction or along y (roll undefined)."""
        position = np.array(spec.position_mm)
        with np.errstate(invalid="ignore"):
            axis = unit(np.array(spec.look_at_mm) - position)
            v0 = unit(np.array([0.0, 1.0, 0.0]) - axis[1] * axis)
        u0 = np.cross(v0, axis)
        roll = np.radians(spec.roll_deg)
        return cls(
            spec=spec,
            position=position,
            axis=axis,
            u_axis=np.cos(roll) * u0 + np.sin(roll) * v0,
            v_axis=-np.sin(roll) * u0 + np.cos(roll) * v0,
        )

    def rays(self, u: Float, v: Float) -> tuple[Float, Float]:
        """Rays (origin, unit direction), each (..., 3), of pixels u, v (...), in air.

        Perspective rays start at the optical centre; orthographic ones on the plane through `position`.
        """
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        du, dv = u - self.spec.centre_px[0], v - self.spec.centre_px[1]
        if self.spec.projection == "orthographic":
            assert self.spec.pixel_mm is not None
            across = du[..., None] * self.u_axis + dv[..., None] * self.v_axis
            origin = self.position + self.spec.pixel_mm * across
            return origin, np.broadcast_to(self.axis, origin.shape)
        assert self.spec.focal_px is not None
        x, y = undistort(du / self.spec.focal_px[0], dv / self.spec.focal_px[1], self.spec.distortion)
        direction = unit(self.axis + x[..., None] * self.u_axis + y[..., None] * self.v_axis)
        return np.broadcast_to(self.position, direction.shape), direction

    def project(self, point: Float) -> tuple[Float, Float]:
        """Pixels (u, v), each (...), at which points (..., 3) in front of the camera appear through air."""
        offset = point - self.position
        x, y = dot(offset, self.u_axis), dot(offset, self.v_axis)
        if self.spec.projection == "orthographic":
            assert self.spec.pixel_mm is not None
            du, dv = x / self.spec.pixel_mm, y / self.spec.pixel_mm
        else:
            assert self.spec.focal_px is not None
            distance = dot(offset, self.axis)
            x, y = distort(x / distance, y / distance, self.spec.distortion)
            du, dv = x * self.spec.focal_px[0], y * self.spec.focal_px[1]
        return du + self.spec.centre_px[0], dv + self.spec.centre_px[1]
