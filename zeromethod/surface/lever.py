"""Lever: propagation of a warp's noise to the slope, at the deformed mirror."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Single
from zeromethod.surface.rays import MirrorRays

_DEPTH_STEP_MM = 0.05
_SLOPE_STEP = 5e-3
_Q_STEP_PX = 0.25
_LEAST_SHARE = 0.1
"""Determinant relative to rest below which the first-order lever is not used (at P0 it vanishes)."""
_BLOCK = 4096
"""Nodes at a time, which fit the processor's nearest memory."""
_LEAST_MIXING = 0.1
"""Determinant of the squared Jacobian over its rows', above which the components' noise is separable."""


@numba.njit(cache=True, error_model="numpy", inline="always")
def _inverse(
    rest: Float, by: NDArray[np.float32], j: int, i: int, d: float, sx: float, sy: float
) -> tuple[float, float, float, float, float]:
    """Entries of a node's sensitivity at a depth and slope, row by row, and 1 over its determinant."""
    ra, rb, rc, re = rest[0, j, i], rest[1, j, i], rest[2, j, i], rest[3, j, i]
    a = ra + by[0, j, i] * d + by[4, j, i] * sx + by[8, j, i] * sy
    b = rb + by[1, j, i] * d + by[5, j, i] * sx + by[9, j, i] * sy
    c = rc + by[2, j, i] * d + by[6, j, i] * sx + by[10, j, i] * sy
    e = re + by[3, j, i] * d + by[7, j, i] * sx + by[11, j, i] * sy
    area, at_rest = a * e - b * c, ra * re - rb * rc
    # also where depth or slope is NaN
    moved = area * at_rest > _LEAST_SHARE * at_rest * at_rest
    a, b, c, e = (a if moved else ra), (b if moved else rb), (c if moved else rc), (e if moved else re)
    return a, b, c, e, 1.0 / (area if moved else at_rest)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _noise(xu: float, xv: float, yu: float, yv: float, x2: float, y2: float) -> tuple[float, float]:
    """Variance of the displacements along u and v from that of the warp, x2 and y2, and its Jacobian."""
    xu, xv, yu, yv = xu * xu, xv * xv, yu * yu, yv * yv
    mixing = xu * yv - xv * yu
    per = 1.0 / mixing
    p, q = (yv * x2 - xv * y2) * per, (xu * y2 - yu * x2) * per
    if (abs(mixing) > _LEAST_MIXING * (xu + xv) * (yu + yv)) & (p > 0.0) & (q > 0.0):
        return p, q
    equal = (x2 + y2) / (xu + xv + yu + yv)
    return equal, equal


@numba.njit(cache=True, error_model="numpy")
def _spread(jacobian: Float, sigma: Float, out: Float) -> None:
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            xu, xv = jacobian[j, i, 0, 0], jacobian[j, i, 0, 1]
            yu, yv = jacobian[j, i, 1, 0], jacobian[j, i, 1, 1]
            u2, v2 = _noise(xu, xv, yu, yv, sigma[j, i, 0] ** 2, sigma[j, i, 1] ** 2)
            out[0, j, i] = xu * xu * u2 + xv * xv * v2
            out[1, j, i] = xu * yu * u2 + xv * yv * v2
            out[2, j, i] = yu * yu * u2 + yv * yv * v2


@numba.njit(cache=True, error_model="numpy")
def _entry(
    rest: Float, by: Single, d: Float, by_x: Single, sx: Float, by_y: Single, sy: Float, out: Float
) -> None:
    """One entry of sensitivities at a depth and slope."""
    for i in range(len(out)):
        out[i] = rest[i] + by[i] * d[i] + by_x[i] * sx[i] + by_y[i] * sy[i]


@numba.njit(cache=True, error_model="numpy")
def _per_area2(a: Float, b: Float, c: Float, e: Float, at_rest: Float, out: Float) -> int:
    """1 over the square of determinants; how many are too small next to those at rest, or NaN.

    at_rest: 1 over those at rest.
    """
    wrong = 0
    for i in range(len(out)):
        area = a[i] * e[i] - b[i] * c[i]
        out[i] = 1.0 / (area * area)
        wrong += not area * at_rest[i] > _LEAST_SHARE
    return wrong


@numba.njit(cache=True, error_model="numpy")
def _propagated(e: Float, b: Float, xx: Float, xy: Float, yy: Float, per2: Float, out: Float) -> None:
    """Variance of one component of slopes."""
    for i in range(len(out)):
        square = e[i] * e[i] * xx[i] - 2.0 * e[i] * b[i] * xy[i] + b[i] * b[i] * yy[i]
        out[i] = square * per2[i]


@numba.njit(cache=True, error_model="numpy")
def _variance(
    rest: Float,
    at_rest: Float,
    by: NDArray[np.float32],
    depth: Float,
    slope: Float,
    spread: Float,
    out: Float,
) -> None:
    """All with nodes last, (..., n), but the result (n, 2). at_rest: 1 over the determinant at rest.

    Block by block, in loops over few arrays, which are vectorised. Without nodes in `depth`, at rest.
    """
    scratch, n = np.empty((7, _BLOCK)), rest.shape[1]
    for start in range(0, n, _BLOCK):
        part, size = slice(start, min(start + _BLOCK, n)), min(_BLOCK, n - start)
        a, b, c, e = scratch[0, :size], scratch[1, :size], scratch[2, :size], scratch[3, :size]
        per2, x2, y2 = scratch[4, :size], scratch[5, :size], scratch[6, :size]
        if len(depth) == 0:
            a, b, c, e = rest[0, part], rest[1, part], rest[2, part], rest[3, part]
            per2[:] = at_rest[part] * at_rest[part]
        else:
            for k in range(4):
                of_depth, of_x, of_y, to = by[k, part], by[4 + k, part], by[8 + k, part], scratch[k, :size]
                _entry(rest[k, part], of_depth, depth[part], of_x, slope[0, part], of_y, slope[1, part], to)
            if _per_area2(a, b, c, e, at_rest[part], per2) > 0:
                for i in range(size):
                    inverse = at_rest[start + i]
                    if not (a[i] * e[i] - b[i] * c[i]) * inverse > _LEAST_SHARE:
                        scratch[:4, i], per2[i] = rest[:, start + i], inverse * inverse
        xx, xy, yy, to = spread[0, part], spread[1, part], spread[2, part], out[part]
        _propagated(e, b, xx, xy, yy, per2, x2)
        _propagated(a, c, yy, xy, xx, per2, y2)
        for i in range(size):
            to[i, 0], to[i, 1] = x2[i], y2[i]


@numba.njit(cache=True, error_model="numpy")
def _factor(
    rest: Float,
    by: NDArray[np.float32],
    depth: Float,
    slope: Float,
    jacobian: Float,
    sigma: Float,
    out: Float,
) -> None:
    for j in range(rest.shape[1]):
        for i in range(rest.shape[2]):
            a, b, c, e, per = _inverse(rest, by, j, i, depth[j, i], slope[0, j, i], slope[1, j, i])
            ju, jv = jacobian[j, i, 0, 0], jacobian[j, i, 0, 1]
            ku, kv = jacobian[j, i, 1, 0], jacobian[j, i, 1, 1]
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
        self._rays, self._rest = rays, np.ascontiguousarray(sensitivity)
        self._planes = _planes(sensitivity)
        a, b, c, e = self._planes
        self._per_area = 1.0 / (a * e - b * c)
        zero = np.zeros(sensitivity.shape[:-2])
        per_slope = []
        for axis in (0, 1):
            step = _SLOPE_STEP * sensitivity[..., axis]
            ahead, back = (self._at(zero, rays.rest_q + sign * step) for sign in (1, -1))
            per_slope.append((ahead - back) / (2 * _SLOPE_STEP))
        by_slope = np.nan_to_num(np.stack(per_slope, axis=-3))
        deeper = np.full(zero.shape, _DEPTH_STEP_MM)
        turned, _ = rays.slope(deeper, rays.rest_q)
        change = self._at(deeper, rays.rest_q) - self._rest
        change -= np.einsum("...a,...aij->...ij", turned, by_slope)
        by_depth = np.nan_to_num(change / _DEPTH_STEP_MM)
        # corrections of a percent, in half the memory
        by = [by_depth, by_slope[..., 0, :, :], by_slope[..., 1, :, :]]
        self._by = np.concatenate([_planes(one) for one in by]).astype(np.float32)

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

    @property
    def planes(self) -> tuple[Float, NDArray[np.float32]]:
        """Sensitivity (4, rows, cols) at rest, row by row; its change (12, ...) by depth and slope x, y."""
        return self._planes, self._by

    def factor(self, jacobian: Float, sigma_q: Float, depth_mm: Float, slope: Float) -> Float:
        """Matrix (rows, cols, 2, 2), rad: slope's error = factor @ (unit noise along u, along v).

        jacobian: (rows, cols, 2, 2) of the warp, LCD px per camera px. sigma_q: (rows, cols, 2) LCD px of the
        warp, from independent displacements along u and v, sigma_q_i^2 = sum_j (dq_i/du_j sigma_j)^2; of
        equal size where the equations do not separate them (a camera turned by 45 degrees). depth_mm (rows,
        cols) and slope (rows, cols, 2): the mirror as read; NaN counts as at rest.
        """
        out = np.empty(jacobian.shape)
        slopes = np.ascontiguousarray(np.moveaxis(slope, -1, 0))
        _factor(self._planes, self._by, depth_mm, slopes, jacobian, sigma_q, out)
        return out

    def spread(self, jacobian: Float, sigma_q: Float) -> Float:
        """Covariance (3, rows, cols) of a warp, LCD px^2: of x, of x with y, of y; arguments as `factor`."""
        out = np.empty((3, *sigma_q.shape[:-1]))
        _spread(jacobian, sigma_q, out)
        return out

    def variance(self, spread: Float, depth_mm: Float | None = None, slope: Float | None = None) -> Float:
        """Variance (rows, cols, 2) of slope, rad^2, by `factor`; without depth and slope that at rest."""
        out = np.empty((*spread.shape[1:], 2))
        n = self._per_area.size
        planes, by, spreads = self._planes.reshape(4, n), self._by.reshape(12, n), spread.reshape(3, n)
        if depth_mm is None or slope is None:
            depth, slopes = np.empty(0), np.empty((2, 0))
        else:
            depth, slopes = depth_mm.reshape(n), np.moveaxis(slope, -1, 0).reshape(2, n)
        _variance(planes, self._per_area.reshape(n), by, depth, slopes, spreads, out.reshape(n, 2))
        return out


def _planes(matrices: Float) -> Float:
    """(4, rows, cols) of (rows, cols, 2, 2), row by row."""
    return np.ascontiguousarray(np.moveaxis(matrices.reshape(*matrices.shape[:-2], 4), -1, 0))
