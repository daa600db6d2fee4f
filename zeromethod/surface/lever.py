"""Lever: propagation of a warp's noise to the slope, at the deformed mirror."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.surface.rays import MirrorRays

_DEPTH_STEP_MM = 0.05
_SLOPE_STEP = 5e-3
_Q_STEP_PX = 0.25
_LEAST_SHARE = 0.1
"""Determinant relative to rest below which the first-order lever is not used (at P0 it vanishes)."""
_LEAST_MIXING = 0.1
"""Determinant of the squared Jacobian over its rows', above which the components' noise is separable."""


@numba.njit(cache=True, error_model="numpy", inline="always")
def _inverse(
    rest: Float,
    by_depth: NDArray[np.float32],
    by_slope: NDArray[np.float32],
    j: int,
    i: int,
    d: float,
    sx: float,
    sy: float,
) -> tuple[float, float, float, float, float]:
    """Entries of a node's sensitivity at a depth and slope, row by row, and 1 over its determinant."""
    ra, rb, rc, re = rest[j, i, 0, 0], rest[j, i, 0, 1], rest[j, i, 1, 0], rest[j, i, 1, 1]
    at_rest = ra * re - rb * rc
    if np.isfinite(d + sx + sy):
        t, u = by_depth, by_slope
        a = ra + t[j, i, 0, 0] * d + u[j, i, 0, 0, 0] * sx + u[j, i, 1, 0, 0] * sy
        b = rb + t[j, i, 0, 1] * d + u[j, i, 0, 0, 1] * sx + u[j, i, 1, 0, 1] * sy
        c = rc + t[j, i, 1, 0] * d + u[j, i, 0, 1, 0] * sx + u[j, i, 1, 1, 0] * sy
        e = re + t[j, i, 1, 1] * d + u[j, i, 0, 1, 1] * sx + u[j, i, 1, 1, 1] * sy
        area = a * e - b * c
        if area * at_rest > _LEAST_SHARE * at_rest * at_rest:
            return a, b, c, e, 1.0 / area
    return ra, rb, rc, re, 1.0 / at_rest


@numba.njit(cache=True, error_model="numpy", inline="always")
def _noise(xu: float, xv: float, yu: float, yv: float, x2: float, y2: float) -> tuple[float, float]:
    """Variance of the displacements along u and v from that of the warp, x2 and y2, and its Jacobian."""
    xu, xv, yu, yv = xu * xu, xv * xv, yu * yu, yv * yv
    mixing = xu * yv - xv * yu
    if abs(mixing) > _LEAST_MIXING * (xu + xv) * (yu + yv):
        per = 1.0 / mixing
        p, q = (yv * x2 - xv * y2) * per, (xu * y2 - yu * x2) * per
        if min(p, q) > 0.0:
            return p, q
    equal = (x2 + y2) / (xu + xv + yu + yv)
    return equal, equal


@numba.njit(cache=True, error_model="numpy")
def _variance(
    rest: Float,
    by_depth: NDArray[np.float32],
    by_slope: NDArray[np.float32],
    depth: Float,
    slope: Float,
    jacobian: Float,
    sigma: Float,
    moved: bool,
    out: Float,
) -> None:
    d = sx = sy = np.nan
    for j in range(rest.shape[0]):
        for i in range(rest.shape[1]):
            if moved:
                d, sx, sy = depth[j, i], slope[j, i, 0], slope[j, i, 1]
            a, b, c, e, per = _inverse(rest, by_depth, by_slope, j, i, d, sx, sy)
            ju, jv, ku, kv = (
                jacobian[j, i, 0, 0],
                jacobian[j, i, 0, 1],
                jacobian[j, i, 1, 0],
                jacobian[j, i, 1, 1],
            )
            u2, v2 = _noise(ju, jv, ku, kv, sigma[j, i, 0] ** 2, sigma[j, i, 1] ** 2)
            per *= per
            xu, xv = e * ju - b * ku, e * jv - b * kv
            yu, yv = a * ku - c * ju, a * kv - c * jv
            out[j, i, 0] = (xu * xu * u2 + xv * xv * v2) * per
            out[j, i, 1] = (yu * yu * u2 + yv * yv * v2) * per


@numba.njit(cache=True, error_model="numpy")
def _factor(
    rest: Float,
    by_depth: NDArray[np.float32],
    by_slope: NDArray[np.float32],
    depth: Float,
    slope: Float,
    jacobian: Float,
    sigma: Float,
    out: Float,
) -> None:
    for j in range(rest.shape[0]):
        for i in range(rest.shape[1]):
            d, sx, sy = depth[j, i], slope[j, i, 0], slope[j, i, 1]
            a, b, c, e, per = _inverse(rest, by_depth, by_slope, j, i, d, sx, sy)
            ju, jv, ku, kv = (
                jacobian[j, i, 0, 0],
                jacobian[j, i, 0, 1],
                jacobian[j, i, 1, 0],
                jacobian[j, i, 1, 1],
            )
            u2, v2 = _noise(ju, jv, ku, kv, sigma[j, i, 0] ** 2, sigma[j, i, 1] ** 2)
            su, sv = np.sqrt(u2) * per, np.sqrt(v2) * per
            out[j, i, 0, 0] = (e * ju - b * ku) * su
            out[j, i, 0, 1] = (e * jv - b * kv) * sv
            out[j, i, 1, 0] = (a * ku - c * ju) * su
            out[j, i, 1, 1] = (a * kv - c * jv) * sv


class Lever:
    """LCD px per rad of slope, to first order in depth and slope, and the slope's noise from a warp's.

    A press of 0.2 mm at 20 mm from the LCD shortens the lever by 1 %, a slope of 20 mrad turns the ray by
    twice that: both are included, their squares (0.1 %) are not. Derivatives by finite differences of
    `MirrorRays.slope`, computed once.
    """

    def __init__(self, rays: MirrorRays, sensitivity: Float) -> None:
        """sensitivity: (rows, cols, 2, 2) LCD px per rad at rest."""
        self._rays = rays
        self._rest = np.ascontiguousarray(sensitivity)
        zero = np.zeros(sensitivity.shape[:-2])
        per_slope = []
        for axis in (0, 1):
            step = _SLOPE_STEP * sensitivity[..., axis]
            ahead, back = (self._at(zero, rays.rest_q + sign * step) for sign in (1, -1))
            per_slope.append((ahead - back) / (2 * _SLOPE_STEP))
        by_slope = np.nan_to_num(np.ascontiguousarray(np.stack(per_slope, axis=-3)))
        deeper = np.full(zero.shape, _DEPTH_STEP_MM)
        turned, _ = rays.slope(deeper, rays.rest_q)
        change = self._at(deeper, rays.rest_q) - self._rest
        change -= np.einsum("...a,...aij->...ij", turned, by_slope)
        # corrections of a percent, in half the memory
        self._by_slope = by_slope.astype(np.float32)
        self._by_depth = np.nan_to_num(change / _DEPTH_STEP_MM).astype(np.float32)

    def _at(self, depth_mm: Float, q: Float) -> Float:
        """Sensitivity (rows, cols, 2, 2) at points at these depths that look at `q`."""
        columns = []
        for axis in (0, 1):
            step = _Q_STEP_PX * (np.arange(2) == axis)
            ahead, back = (self._rays.slope(depth_mm, q + sign * step)[0] for sign in (1, -1))
            columns.append((ahead - back) / (2 * _Q_STEP_PX))
        per_q = np.stack(columns, axis=-1)
        regular = np.isfinite(per_q).all(axis=(-1, -2), keepdims=True)
        inverse = np.linalg.inv(np.where(regular, per_q, np.eye(2)))
        return np.where(regular, inverse, self._rest)

    def factor(self, jacobian: Float, sigma_q: Float, depth_mm: Float, slope: Float) -> Float:
        """Matrix (rows, cols, 2, 2), rad: slope's error = factor @ (unit noise along u, along v).

        jacobian: (rows, cols, 2, 2) of the warp, LCD px per camera px. sigma_q: (rows, cols, 2) LCD px of the
        warp, from independent displacements along u and v, sigma_q_i^2 = sum_j (dq_i/du_j sigma_j)^2; of
        equal size where the equations do not separate them (a camera turned by 45 degrees). depth_mm (rows,
        cols) and slope (rows, cols, 2): the mirror as read; NaN counts as at rest.
        """
        out = np.empty(jacobian.shape)
        _factor(self._rest, self._by_depth, self._by_slope, depth_mm, slope, jacobian, sigma_q, out)
        return out

    def variance(
        self, jacobian: Float, sigma_q: Float, depth_mm: Float | None = None, slope: Float | None = None
    ) -> Float:
        """Variance (rows, cols, 2) of slope, rad^2, by that matrix; without depth and slope that at rest."""
        out = np.empty(sigma_q.shape)
        moved = depth_mm is not None and slope is not None
        depth_mm = np.zeros((1, 1)) if depth_mm is None else depth_mm
        # of the layout that readings have, so that one version is compiled
        slope = np.moveaxis(np.zeros((2, 1, 1)), 0, -1) if slope is None else slope
        _variance(self._rest, self._by_depth, self._by_slope, depth_mm, slope, jacobian, sigma_q, moved, out)
        return out
