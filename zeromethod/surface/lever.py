"""Lever: propagation of a warp's noise to the slope, at the deformed mirror."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.kernels import kernel, read
from zeromethod.surface.rays import MirrorRays

_DEPTH_STEP_MM = 0.05
_SLOPE_STEP = 5e-3
_Q_STEP_PX = 0.25
_LEAST_SHARE = 0.1
"""Determinant relative to rest below which the first-order lever is not used (at P0 it vanishes)."""
_LEAST_MIXING = 0.1
"""Determinant of the squared Jacobian over its rows', above which the components' noise is separable."""


@kernel(read(numba.float64, 4), read(numba.float64, 3), numba.float64[:, :, ::1])
def _noise(jacobian: Any, sigma: Any, out: Any) -> None:
    """Variance (2, rows, cols) of the displacements along u and v, from a warp's Jacobian and its sigma."""
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            xu, xv, x2 = jacobian[j, i, 0, 0] ** 2, jacobian[j, i, 0, 1] ** 2, sigma[j, i, 0] ** 2
            yu, yv, y2 = jacobian[j, i, 1, 0] ** 2, jacobian[j, i, 1, 1] ** 2, sigma[j, i, 1] ** 2
            mixing = xu * yv - xv * yu
            per = 1.0 / mixing
            p, q = (yv * x2 - xv * y2) * per, (xu * y2 - yu * x2) * per
            separable = (abs(mixing) > _LEAST_MIXING * (xu + xv) * (yu + yv)) & (p > 0.0) & (q > 0.0)
            equal = (x2 + y2) / (xu + xv + yu + yv)
            out[0, j, i], out[1, j, i] = (p if separable else equal), (q if separable else equal)


_ROWS, _LINE = read(numba.float64, 2), read(numba.float64, 1)


@kernel(_ROWS, _LINE, read(numba.float32, 2), _LINE, _ROWS, numba.float64[:, ::1])
def _moved(rest: Any, at_rest: Any, by: Any, depth: Any, slope: Any, out: Any) -> None:
    """Entries of sensitivities at a depth and slope, row by row, and 1 over their determinants, (5, n).

    at_rest: 1 over the determinants at rest.
    """
    for i in range(len(depth)):
        d, sx, sy = depth[i], slope[0, i], slope[1, i]
        a = rest[0, i] + by[0, i] * d + by[4, i] * sx + by[8, i] * sy
        b = rest[1, i] + by[1, i] * d + by[5, i] * sx + by[9, i] * sy
        c = rest[2, i] + by[2, i] * d + by[6, i] * sx + by[10, i] * sy
        e = rest[3, i] + by[3, i] * d + by[7, i] * sx + by[11, i] * sy
        area = a * e - b * c
        if area * at_rest[i] > _LEAST_SHARE:
            out[0, i], out[1, i], out[2, i], out[3, i], out[4, i] = a, b, c, e, 1.0 / area
        else:
            # also where depth or slope is NaN
            for k in range(4):
                out[k, i] = rest[k, i]
            out[4, i] = at_rest[i]


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

    @np.errstate(all="ignore")
    def factor(self, jacobian: Float, sigma_q: Float, depth_mm: Float, slope: Float) -> Float:
        """Matrix (rows, cols, 2, 2), rad: slope's error = factor @ (unit noise along u, along v).

        jacobian: (rows, cols, 2, 2) of the warp, LCD px per camera px. sigma_q: (rows, cols, 2) LCD px of the
        warp, from independent displacements along u and v, sigma_q_i^2 = sum_j (dq_i/du_j sigma_j)^2; of
        equal size where the equations do not separate them (a camera turned by 45 degrees). depth_mm (rows,
        cols) and slope (rows, cols, 2): the mirror as read; NaN counts as at rest.
        """
        a, b, c, e, per_area = self._at_mirror(depth_mm, slope)
        noise = np.empty((2, *depth_mm.shape))
        _noise(jacobian, sigma_q, noise)
        out = np.empty(jacobian.shape)
        for axis in (0, 1):
            x, y, size = jacobian[..., 0, axis], jacobian[..., 1, axis], np.sqrt(noise[axis]) * per_area
            out[..., 0, axis] = (e * x - b * y) * size
            out[..., 1, axis] = (a * y - c * x) * size
        return out

    @np.errstate(all="ignore")
    def spread(self, jacobian: Float, sigma_q: Float) -> Float:
        """Covariance (3, rows, cols) of a warp, LCD px^2: of x, of x with y, of y; arguments as `factor`."""
        noise = np.empty((2, *sigma_q.shape[:-1]))
        _noise(jacobian, sigma_q, noise)
        (xu, xv, yu, yv), (u2, v2) = _planes(jacobian), noise
        along_u, along_v, out = xu * u2, xv * v2, np.empty((3, *u2.shape))
        np.add(xu * along_u, xv * along_v, out=out[0])
        np.add(yu * along_u, yv * along_v, out=out[1])
        np.add(yu * yu * u2, yv * yv * v2, out=out[2])
        return out

    @np.errstate(all="ignore")
    def variance(self, spread: Float, depth_mm: Float | None = None, slope: Float | None = None) -> Float:
        """Variance (rows, cols, 2) of slope, rad^2, by `factor`; without depth and slope that at rest."""
        if depth_mm is None or slope is None:
            a, b, c, e, per_area = *self._planes, self._per_area
        else:
            a, b, c, e, per_area = self._at_mirror(depth_mm, slope)
        xx, xy, yy = spread
        per2 = per_area * per_area
        out = np.empty((*per2.shape, 2))
        out[..., 0] = (e * (e * xx - b * xy) + b * (b * yy - e * xy)) * per2
        out[..., 1] = (a * (a * yy - c * xy) + c * (c * xx - a * xy)) * per2
        return out

    def _at_mirror(self, depth_mm: Float, slope: Float) -> Float:
        """Entries (4, ...) of the sensitivity at a depth and slope, and 1 over its determinant."""
        out, n = np.empty((5, *depth_mm.shape)), depth_mm.size
        of_rest = self._planes.reshape(4, n), self._per_area.reshape(n), self._by.reshape(12, n)
        _moved(*of_rest, depth_mm.reshape(n), np.moveaxis(slope, -1, 0).reshape(2, n), out.reshape(5, n))
        return out


def _planes(matrices: Float) -> Float:
    """(4, rows, cols) of (rows, cols, 2, 2), row by row."""
    return np.ascontiguousarray(np.moveaxis(matrices.reshape(*matrices.shape[:-2], 4), -1, 0))
