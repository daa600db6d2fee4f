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

_TWO_THIRDS, _TWELFTH = 2 / 3, 1 / 12

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
        above2, above, here, below, below2 = q[j - 2], q[j - 1], q[j], q[j + 1], q[j + 2]
        xu = _TWO_THIRDS * (here[i + 1, 0] - here[i - 1, 0]) - _TWELFTH * (here[i + 2, 0] - here[i - 2, 0])
        yu = _TWO_THIRDS * (here[i + 1, 1] - here[i - 1, 1]) - _TWELFTH * (here[i + 2, 1] - here[i - 2, 1])
        xv = _TWO_THIRDS * (below[i, 0] - above[i, 0]) - _TWELFTH * (below2[i, 0] - above2[i, 0])
        yv = _TWO_THIRDS * (below[i, 1] - above[i, 1]) - _TWELFTH * (below2[i, 1] - above2[i, 1])
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
def _areas(q: Float, out: Float) -> None:
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            xu, xv, yu, yv = _derivatives(q, j, i)
            out[j, i] = xu * yv - xv * yu


@numba.njit(cache=True, error_model="numpy")
def _flags(q: Float, rest_area: Float, period_nodes: float, columns: float, rows: float, out: Flags) -> None:
    for j in range(q.shape[0]):
        for i in range(q.shape[1]):
            xu, xv, yu, yv = _derivatives(q, j, i)
            area = xu * yv - xv * yu
            rest = rest_area[j, i]
            flags = 0
            if area * rest < FOLDED_BELOW * rest * rest:
                flags |= _FOLDED
            longest = max(xu * xu + yu * yu, xv * xv + yv * yv)
            x, y = q[j, i, 0], q[j, i, 1]
            room_x, room_y = min(x + 0.5, columns - 0.5 - x), min(y + 0.5, rows - 0.5 - y)
            drawable = (period_nodes * area) ** 2 >= FEWEST_LCD_PX**2 * longest  # false at NaN
            if not (drawable and math.isfinite(x + y)):
                flags |= _UNDRAWABLE
            wide_x = period_nodes * period_nodes * (xu * xu + xv * xv) > room_x * room_x
            wide_y = period_nodes * period_nodes * (yu * yu + yv * yv) > room_y * room_y
            if room_x < 0.0 or room_y < 0.0 or wide_x or wide_y:
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


def areas(q: Float) -> Float:
    """Area on the LCD per node (rows, cols) of a warp (rows, cols, 2), LCD px^2; negative where mirrored."""
    out = np.empty(q.shape[:2])
    _areas(q, out)
    return out


def warp_flags(
    q: Float,
    q_rest: Float,
    period_px: float,
    display_size: tuple[int, int],
    *,
    spacing_px: float | None = None,
    rest_areas: Float | None = None,
) -> Flags:
    """`Flag` bits of nodes that cannot be nulled or drawn, (rows, cols) uint16.

    FOLDED: mirrored against rest, or its area is below 2 % of that at rest.
    UNDRAWABLE: fewer than 4 LCD px per carrier period of either carrier, measured across its fringes
    (period |det J| / |dq/dv| for the carrier along u and the other way round), or q is NaN.
    OFF_DISPLAY: within one carrier period of the node, q leaves the panel (to first order), so the
    sensing window around the node contains more than the target.

    q, q_rest: (rows, cols, 2) LCD px. display_size: (columns, rows) LCD px. spacing_px: camera px between
    nodes, half a period unless given. rest_areas: `areas` of q_rest, where they are known.
    """
    out = np.empty(q.shape[:2], dtype=np.uint16)
    period_nodes = 2.0 if spacing_px is None else period_px / spacing_px
    _flags(q, areas(q_rest) if rest_areas is None else rest_areas, period_nodes, *display_size, out)
    return out
