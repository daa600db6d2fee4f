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


@numba.njit(cache=True, error_model="numpy")
def _apart(ahead2: Float, ahead: Float, back: Float, back2: Float, out: Float) -> None:
    """Fourth-order central differences (n,), of values one and two nodes away."""
    for k in range(len(out)):
        out[k] = _TWO_THIRDS * (ahead[k] - back[k]) - _TWELFTH * (ahead2[k] - back2[k])


@numba.njit(cache=True, error_model="numpy")
def _unknown(row: Float) -> int:
    """How many nodes of a row of derivatives (2, cols, 2) are not finite."""
    count, along, across = 0, row[0], row[1]
    for i in range(along.shape[0]):
        count += not math.isfinite(along[i, 0] + along[i, 1] + across[i, 0] + across[i, 1])
    return count


@numba.njit(cache=True, error_model="numpy")
def _near(back: float, here: float, ahead: float) -> float:
    """Difference per node by next neighbours, of the highest order that finite ones allow."""
    central: float = 0.5 * (ahead - back)
    if math.isfinite(central):
        return central
    forward: float = ahead - here
    return forward if math.isfinite(forward) else here - back


@numba.njit(cache=True, error_model="numpy")
def _at_edge(q: Float, j: int, first: int, last: int, out: Float) -> None:
    """Derivatives (2, cols, 2) of nodes first to last - 1 of row j, wherever they lie."""
    for i in range(first, last):
        for k in range(2):
            out[0, i, k], out[1, i, k] = _along(q, j, i, k, 0, 1), _along(q, j, i, k, 1, 0)


@numba.njit(cache=True, error_model="numpy")
def _mend(q: Float, j: int, first: int, last: int, out: Float) -> None:
    """Replace derivatives (2, cols, 2) of nodes first to last - 1 of row j that are not finite."""
    above, row, below = q[j - 1], q[j], q[j + 1]
    for i in range(first, last):
        for k in range(2):
            if not math.isfinite(out[0, i, k]):
                out[0, i, k] = _near(row[i - 1, k], row[i, k], row[i + 1, k])
            if not math.isfinite(out[1, i, k]):
                out[1, i, k] = _near(above[i, k], row[i, k], below[i, k])


@numba.njit(cache=True, error_model="numpy")
def _derivatives(q: Float, j: int, margin: int, out: Float) -> None:
    """d(x, y)/du and d(x, y)/dv per node, (2, cols, 2), of a row of nodes, but for a margin at its ends."""
    rows, cols = q.shape[0], q.shape[1]
    first = last = cols - margin
    if 2 <= j < rows - 2 and cols > 4:
        # rows as lines of numbers, without branches
        line, size = q[j].reshape(2 * cols), 2 * cols - 8
        _apart(
            line[8:],
            line[6 : 6 + size],
            line[2 : 2 + size],
            line[:size],
            out[0].reshape(2 * cols)[4 : 4 + size],
        )
        above2, above, below, below2 = q[j - 2], q[j - 1], q[j + 1], q[j + 2]
        _apart(
            below2.reshape(2 * cols),
            below.reshape(2 * cols),
            above.reshape(2 * cols),
            above2.reshape(2 * cols),
            out[1].reshape(2 * cols),
        )
        first, last = max(2, margin), cols - max(2, margin)
    _at_edge(q, j, margin, first, out)
    _at_edge(q, j, last, cols - margin, out)
    # nodes that are not known are mostly those at the ends
    a, b = first, last
    while a < b and not math.isfinite(out[0, a, 0] + out[1, a, 0]):
        a += 1
    while a < b and not math.isfinite(out[0, b - 1, 0] + out[1, b - 1, 0]):
        b -= 1
    _mend(q, j, first, a, out)
    _mend(q, j, b, last, out)
    if _unknown(out[:, a:b]):
        _mend(q, j, a, b, out)


@numba.njit(cache=True, error_model="numpy")
def _jacobian(q: Float, scale: float, margin: int, out: Float) -> None:
    row = np.empty((2, q.shape[1], 2))
    end = q.shape[1] - margin
    along, across = row[0, margin:end], row[1, margin:end]
    for j in range(out.shape[0]):
        _derivatives(q, j + margin, margin, row)
        to = out[j]
        for i in range(out.shape[1]):
            to[i, 0, 0] = scale * along[i, 0]
            to[i, 0, 1] = scale * across[i, 0]
            to[i, 1, 0] = scale * along[i, 1]
            to[i, 1, 1] = scale * across[i, 1]


@numba.njit(cache=True, error_model="numpy")
def _areas(q: Float, out: Float) -> None:
    row = np.empty((2, q.shape[1], 2))
    along, across = row[0], row[1]
    for j in range(q.shape[0]):
        _derivatives(q, j, 0, row)
        to = out[j]
        for i in range(q.shape[1]):
            to[i] = along[i, 0] * across[i, 1] - across[i, 0] * along[i, 1]


@numba.njit(cache=True, error_model="numpy")
def _flags(q: Float, rest_area: Float, period_nodes: float, columns: float, rows: float, out: Flags) -> None:
    row = np.empty((2, q.shape[1], 2))
    along, across = row[0], row[1]
    period2, fewest2 = period_nodes * period_nodes, FEWEST_LCD_PX**2
    for j in range(q.shape[0]):
        _derivatives(q, j, 0, row)
        here, rest, to = q[j], rest_area[j], out[j]
        for i in range(q.shape[1]):
            xu, yu, xv, yv, x, y = (
                along[i, 0],
                along[i, 1],
                across[i, 0],
                across[i, 1],
                here[i, 0],
                here[i, 1],
            )
            area = xu * yv - xv * yu
            folded = area * rest[i] < FOLDED_BELOW * rest[i] * rest[i]
            longest = max(xu * xu + yu * yu, xv * xv + yv * yv)
            room_x, room_y = min(x + 0.5, columns - 0.5 - x), min(y + 0.5, rows - 0.5 - y)
            drawable = (period2 * area * area >= fewest2 * longest) & math.isfinite(x + y)  # false at NaN
            wide = (period2 * (xu * xu + xv * xv) > room_x * room_x) | (
                period2 * (yu * yu + yv * yv) > room_y * room_y
            )
            off = (room_x < 0.0) | (room_y < 0.0) | wide
            to[i] = (
                (_FOLDED if folded else 0) | (0 if drawable else _UNDRAWABLE) | (_OFF_DISPLAY if off else 0)
            )


def jacobian(q: Float, spacing_px: float, margin: int = 0) -> Float:
    """Jacobian of a warp by camera position: (rows, cols, 2, 2), [..., i, j] = dq_i / du_j.

    q: (rows, cols, 2) LCD px. margin: nodes on each side that are left out. Result in LCD px per camera px,
    by fourth-order central differences; of second and first order at the grid's edge and next to NaN nodes.

    Convention: q = (column, row), u = (column, row).
    """
    out = np.empty((q.shape[0] - 2 * margin, q.shape[1] - 2 * margin, 2, 2))
    _jacobian(np.ascontiguousarray(q), 1.0 / spacing_px, margin, out)
    return out


def areas(q: Float) -> Float:
    """Area on the LCD per node (rows, cols) of a warp (rows, cols, 2), LCD px^2; negative where mirrored."""
    out = np.empty(q.shape[:2])
    _areas(np.ascontiguousarray(q), out)
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
    _flags(
        np.ascontiguousarray(q),
        areas(q_rest) if rest_areas is None else np.ascontiguousarray(rest_areas),
        period_nodes,
        *display_size,
        out,
    )
    return out
