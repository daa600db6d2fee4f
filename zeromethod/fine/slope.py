"""Slope of every pixel from its measured LCD position, by the nodes' rays.

A node's position is q = R + A s + (s_x B_x + s_y B_y) s / 2: s its slope, A the lever at its depth, B what
the lever changes by with slope (`surface.lever`), and R what remains, so that nodes are exact. R, A and B
vary slowly over the view and are interpolated to the pixels, and solved there for s. Tracing each pixel's ray
would take a second.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.fine.lattice import PixelLattice
from zeromethod.kernels import kernel, read
from zeromethod.rounding import REORDERED
from zeromethod.surface.lever import Lever

_PASSES = 3


@kernel(
    read(numba.float32, 3),
    read(numba.float32, 3),
    read(numba.float32, 3),
    numba.float32[:, ::1],
    numba.float32[:, ::1],
    numba.float32[:, ::1],
    numba.float32[:, ::1],
    fastmath=REORDERED,
)
def _solve(
    planes: Single,
    detail: Single,
    variance: Single,
    x_slope: Single,
    y_slope: Single,
    x_slope2: Single,
    y_slope2: Single,
) -> None:
    """Slopes and their variances (rows, cols) of some rows; planes: (rows, 20, cols) of `Planes`."""
    rows, cols = detail.shape[0], detail.shape[1]
    half, one = np.float32(0.5), np.float32(1.0)
    for j in range(rows):
        at = planes[j]
        for i in range(cols):
            x, y = detail[j, i, 0] + at[0, i], detail[j, i, 1] + at[1, i]
            sx, sy = at[18, i], at[19, i]
            a = b = c = e = area = np.float32(0.0)
            for _ in range(_PASSES):
                a = at[2, i] + half * (at[6, i] * sx + at[10, i] * sy)
                b = at[3, i] + half * (at[7, i] * sx + at[11, i] * sy)
                c = at[4, i] + half * (at[8, i] * sx + at[12, i] * sy)
                e = at[5, i] + half * (at[9, i] * sx + at[13, i] * sy)
                area = one / (a * e - b * c)
                sx, sy = (e * x - b * y) * area, (a * y - c * x) * area
            x_slope[j, i], y_slope[j, i] = sx, sy
            xu, xv, yu, yv = at[14, i], at[15, i], at[16, i], at[17, i]
            u2, v2 = variance[j, i, 0] * (area * area), variance[j, i, 1] * (area * area)
            of_xu, of_xv, of_yu, of_yv = e * xu - b * yu, e * xv - b * yv, a * yu - c * xu, a * yv - c * xv
            x_slope2[j, i] = of_xu * of_xu * u2 + of_xv * of_xv * v2
            y_slope2[j, i] = of_yu * of_yu * u2 + of_yv * of_yv * v2


def lever_planes(lever: Lever, depth_mm: Float, slope: Float) -> tuple[Float, Float, Float]:
    """(lever (4, rows, cols), by slope (8, rows, cols), A s + s B s / 2 (2, rows, cols)) of the nodes.

    depth_mm: (rows, cols), slope: (rows, cols, 2), finite.
    """
    rest, by = lever.planes
    here: Float = rest + by[:4] * depth_mm
    sx, sy = slope[..., 0], slope[..., 1]
    half = here + 0.5 * (by[4:8] * sx + by[8:] * sy)
    turned = np.stack([half[0] * sx + half[1] * sy, half[2] * sx + half[3] * sy]).astype(np.float64)
    return here, by[4:].astype(np.float64), turned


class Planes(NamedTuple):
    """The nodes' rays.

    away: (2, rows, cols) LCD px, the nodes' position less R. lever (4, ...), by_slope (8, ...): of
    `lever_planes`. jacobian: (4, rows, cols) of the warp, LCD px per camera px. start: (2, rows, cols) slope
    to begin with.
    """

    away: Float
    lever: Float
    by_slope: Float
    jacobian: Float
    start: Float


def pixel_slopes(
    lattice: PixelLattice, detail: Single, planes: Planes, variance: Single
) -> tuple[Single, Single]:
    """Slope and its variance, (2, rows, cols), rad and rad^2.

    detail: (rows, cols, 2) LCD px beyond the nodes' interpolated position. variance: (rows, cols, 2) of the
    displacement, px^2.
    """
    slope, slope2 = (np.empty((2, *lattice.shape), np.float32) for _ in range(2))
    for rows, between in lattice.bands(np.concatenate(planes), np.float32):
        _solve(between, detail[rows], variance[rows], *slope[:, rows], *slope2[:, rows])
    return slope, slope2
