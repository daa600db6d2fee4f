"""Jacobian of a warp, and the flags that follow from it: folds, aliasing, the panel's edge."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Flags, Float
from zeromethod.kernels import kernel, piece, read
from zeromethod.warp.validity import Flag

FOLDED_BELOW = 0.02
"""Area relative to rest below which a node counts as folded: a caustic, no longer one to one."""

FEWEST_LCD_PX = 4.0
"""LCD px per carrier period, measured across the fringes, below which the carrier aliases."""

_FOLDED = int(Flag.FOLDED)
_UNDRAWABLE = int(Flag.UNDRAWABLE)
_OFF_DISPLAY = int(Flag.OFF_DISPLAY)


@piece
def _difference(back2: float, back: float, here: float, ahead: float, ahead2: float) -> float:
    """Difference per node of values at nodes in a row, of the highest order that finite ones allow."""
    wide: float = (8.0 * (ahead - back) - (ahead2 - back2)) / 12.0
    if math.isfinite(wide):
        return wide
    central: float = 0.5 * (ahead - back)
    if math.isfinite(central):
        return central
    forward: float = ahead - here
    return forward if math.isfinite(forward) else here - back


@kernel(read(numba.float64, 3), numba.int64, numba.float64, numba.float64[:, :, :, ::1])
def _jacobian(padded: Float, skip: int, scale: float, out: Float) -> None:
    """Differences per node times a scale; padded: (rows + 2 skip, cols + 2 skip, 2) q, skip at least 2."""
    for j in range(out.shape[0]):
        above2, above, row = padded[j + skip - 2], padded[j + skip - 1], padded[j + skip]
        below, below2 = padded[j + skip + 1], padded[j + skip + 2]
        for i in range(out.shape[1]):
            n = i + skip
            for k in range(2):
                along = _difference(row[n - 2, k], row[n - 1, k], row[n, k], row[n + 1, k], row[n + 2, k])
                across = _difference(above2[n, k], above[n, k], row[n, k], below[n, k], below2[n, k])
                out[j, i, k, 0], out[j, i, k, 1] = scale * along, scale * across


@kernel(
    read(numba.float64, 3), read(numba.float64, 4), read(numba.float64, 2),
    numba.float64, numba.float64, numba.float64, numba.uint16[:, ::1],
)  # fmt: skip
def _flags(
    q: Float, per_node: Float, rest_area: Float, period_nodes: float, columns: float, rows: float, out: Flags
) -> None:
    period2, fewest2 = period_nodes * period_nodes, FEWEST_LCD_PX**2
    for j in range(q.shape[0]):
        here, slopes, rests, to = q[j], per_node[j], rest_area[j], out[j]
        for i in range(q.shape[1]):
            x, y, rest = here[i, 0], here[i, 1], rests[i]
            xu, xv, yu, yv = slopes[i, 0, 0], slopes[i, 0, 1], slopes[i, 1, 0], slopes[i, 1, 1]
            area = xu * yv - xv * yu
            folded = area * rest < FOLDED_BELOW * rest * rest
            longest = max(xu * xu + yu * yu, xv * xv + yv * yv)
            room_x, room_y = min(x + 0.5, columns - 0.5 - x), min(y + 0.5, rows - 0.5 - y)
            drawable = (period2 * area * area >= fewest2 * longest) & math.isfinite(x + y)  # false at NaN
            wide_x = period2 * (xu * xu + xv * xv) > room_x * room_x
            wide_y = period2 * (yu * yu + yv * yv) > room_y * room_y
            off = (room_x < 0.0) | (room_y < 0.0) | wide_x | wide_y
            drawn = (0 if drawable else _UNDRAWABLE) | (_OFF_DISPLAY if off else 0)
            to[i] = (_FOLDED if folded else 0) | drawn


def jacobian(q: Float, spacing_px: float, margin: int = 0) -> Float:
    """Jacobian of a warp by camera position: (rows, cols, 2, 2), [..., i, j] = dq_i / du_j.

    q: (rows, cols, 2) LCD px. margin: nodes on each side that are left out. Result in LCD px per camera px,
    by fourth-order central differences; of second and first order at the grid's edge and next to NaN nodes.

    Convention: q = (column, row), u = (column, row).
    """
    edge = max(2 - margin, 0)
    rows, cols, _ = q.shape
    padded = q
    if edge:
        padded = np.full((rows + 2 * edge, cols + 2 * edge, 2), np.nan)
        padded[edge:-edge, edge:-edge] = q
    out = np.empty((rows - 2 * margin, cols - 2 * margin, 2, 2))
    _jacobian(padded, margin + edge, 1.0 / spacing_px, out)
    return out


def areas(q: Float) -> Float:
    """Area on the LCD per node (rows, cols) of a warp (rows, cols, 2), LCD px^2; negative where mirrored."""
    (xu, xv), (yu, yv) = np.moveaxis(jacobian(q, 1.0), (2, 3), (0, 1))
    return np.asarray(xu * yv - xv * yu)


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
    rest = areas(q_rest) if rest_areas is None else rest_areas
    _flags(q, jacobian(q, 1.0), rest, period_nodes, *display_size, out)
    return out
