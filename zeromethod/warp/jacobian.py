"""Jacobian of a warp, and the flags that follow from it: folds, aliasing, the panel's edge."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Flags, Float
from zeromethod.warp.validity import Flag

FOLDED_BELOW = 0.02
"""Area relative to rest below which a node counts as folded: a caustic, no longer one to one."""

FEWEST_LCD_PX = 4.0
"""LCD px per carrier period, measured across the fringes, below which the carrier aliases."""

_FOLDED = int(Flag.FOLDED)
_UNDRAWABLE = int(Flag.UNDRAWABLE)
_OFF_DISPLAY = int(Flag.OFF_DISPLAY)


@numba.njit(cache=True, error_model="numpy")
def _along(q: Float, j: int, i: int, k: int, dj: int, di: int) -> float:
    """Difference per node along (dj, di), of the highest order that grid and finite neighbours allow."""
    rows, cols = q.shape[0], q.shape[1]
    if 2 * dj <= j < rows - 2 * dj and 2 * di <= i < cols - 2 * di:
        near = q[j + dj, i + di, k] - q[j - dj, i - di, k]
        far = q[j + 2 * dj, i + 2 * di, k] - q[j - 2 * dj, i - 2 * di, k]
        wide: float = (8.0 * near - far) / 12.0
        if math.isfinite(wide):
            return wide
    back = q[j - dj, i - di, k] if j >= dj and i >= di else math.nan
    ahead = q[j + dj, i + di, k] if j + dj < rows and i + di < cols else math.nan
    central: float = 0.5 * (ahead - back)
    if math.isfinite(central):
        return central
    forward: float = ahead - q[j, i, k]
    backward: float = q[j, i, k] - back
    return forward if math.isfinite(forward) else backward


@numba.njit(cache=True, error_model="numpy", inline="always")
def _derivatives(q: Float, j: int, i: int) -> tuple[float, float, float, float]:
    """dx/du, dx/dv, dy/du, dy/dv per node."""
    if 2 <= j < q.shape[0] - 2 and 2 <= i < q.shape[1] - 2:  # shortcut without branches for most nodes
        a, b, c, d = q[j, i - 2], q[j, i - 1], q[j, i + 1], q[j, i + 2]
        e, f, g, h = q[j - 2, i], q[j - 1, i], q[j + 1, i], q[j + 2, i]
        xu = (8.0 * (c[0] - b[0]) - (d[0] - a[0])) / 12.0
        yu = (8.0 * (c[1] - b[1]) - (d[1] - a[1])) / 12.0
        xv = (8.0 * (g[0] - f[0]) - (h[0] - e[0])) / 12.0
        yv = (8.0 * (g[1] - f[1]) - (h[1] - e[1])) / 12.0
        if math.isfinite(xu + yu + xv + yv):
            return xu, xv, yu, yv
    return (
        _along(q, j, i, 0, 0, 1),
        _along(q, j, i, 0, 1, 0),
        _along(q, j, i, 1, 0, 1),
        _along(q, j, i, 1, 1, 0),
    )


@numba.njit(cache=True, error_model="numpy")
def _jacobian(q: Float, scale: float, out: Float) -> None:
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            xu, xv, yu, yv = _derivatives(q, j, i)
            out[j, i, 0, 0] = scale * xu
            out[j, i, 0, 1] = scale * xv
            out[j, i, 1, 0] = scale * yu
            out[j, i, 1, 1] = scale * yv


@numba.njit(cache=True, error_model="numpy")
def _flags(q: Float, q_rest: Float, period_nodes: float, columns: float, rows: float, out: Flags) -> None:
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            xu, xv, yu, yv = _derivatives(q, j, i)
            ru, rv, su, sv = _derivatives(q_rest, j, i)
            area = xu * yv - xv * yu
            rest = ru * sv - rv * su
            flags = 0
            if area * rest < FOLDED_BELOW * rest * rest:
                flags |= _FOLDED
            longest = max(xu * xu + yu * yu, xv * xv + yv * yv)
            margin_x = period_nodes * math.sqrt(xu * xu + xv * xv) - 0.5
            margin_y = period_nodes * math.sqrt(yu * yu + yv * yv) - 0.5
            x, y = q[j, i, 0], q[j, i, 1]
            drawable = (period_nodes * area) ** 2 >= FEWEST_LCD_PX**2 * longest  # false at NaN
            if not (drawable and math.isfinite(x + y)):
                flags |= _UNDRAWABLE
            if x < margin_x or x > columns - 1.0 - margin_x or y < margin_y or y > rows - 1.0 - margin_y:
                flags |= _OFF_DISPLAY
            out[j, i] = flags


def jacobian(q: Float, spacing_px: float) -> Float:
    """Jacobian of a warp by camera position: (rows, cols, 2, 2), [..., i, j] = dq_i / du_j.

    q: (rows, cols, 2) LCD px. Result in LCD px per camera px, by fourth-order central differences; of
    second and first order at the grid's edge and next to NaN nodes.

    Convention: q = (column, row), u = (column, row).
    """
    out = np.empty((*q.shape, 2))
    _jacobian(q, 1.0 / spacing_px, out)
    return out


def warp_flags(
    q: Float,
    q_rest: Float,
    period_px: float,
    display_size: tuple[int, int],
    *,
    spacing_px: float | None = None,
) -> Flags:
    """`Flag` bits of nodes that cannot be nulled or drawn, (rows, cols) uint16.

    FOLDED: mirrored against rest, or its area is below 2 % of that at rest.
    UNDRAWABLE: fewer than 4 LCD px per carrier period of either carrier, measured across its fringes
    (period |det J| / |dq/dv| for the carrier along u and the other way round), or q is NaN.
    OFF_DISPLAY: within one carrier period of the node, q leaves the panel (to first order), so the
    sensing window around the node contains more than the target.

    q, q_rest: (rows, cols, 2) LCD px. display_size: (columns, rows) LCD px. spacing_px: camera px between
    nodes, half a period unless given.
    """
    out = np.empty(q.shape[:2], dtype=np.uint16)
    period_nodes = 2.0 if spacing_px is None else period_px / spacing_px
    _flags(q, q_rest, period_nodes, display_size[0], display_size[1], out)
    return out
