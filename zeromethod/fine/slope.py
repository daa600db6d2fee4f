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
from zeromethod.surface.lever import Lever

_PASSES = 3


@numba.njit(cache=True, error_model="numpy")
def _solve(
    detail: Single,
    away: Single,
    lever: Single,
    by_slope: Single,
    jacobian: Single,
    variance: Single,
    slope: Single,
    slope2: Single,
) -> None:
    rows, cols = away.shape[1], away.shape[2]
    for j in range(rows):
        for i in range(cols):
            x, y = detail[j, i, 0] + away[0, j, i], detail[j, i, 1] + away[1, j, i]
            sx, sy = slope[0, j, i], slope[1, j, i]
            a = b = c = e = area = 0.0
            for _ in range(_PASSES):
                ha = 0.5 * (by_slope[0, j, i] * sx + by_slope[4, j, i] * sy)
                hb = 0.5 * (by_slope[1, j, i] * sx + by_slope[5, j, i] * sy)
                hc = 0.5 * (by_slope[2, j, i] * sx + by_slope[6, j, i] * sy)
                he = 0.5 * (by_slope[3, j, i] * sx + by_slope[7, j, i] * sy)
                a, b, c, e = (
                    lever[0, j, i] + ha,
                    lever[1, j, i] + hb,
                    lever[2, j, i] + hc,
                    lever[3, j, i] + he,
                )
                area = a * e - b * c
                sx, sy = (e * x - b * y) / area, (a * y - c * x) / area
            slope[0, j, i], slope[1, j, i] = sx, sy
            xu, xv, yu, yv = jacobian[0, j, i], jacobian[1, j, i], jacobian[2, j, i], jacobian[3, j, i]
            u2, v2 = variance[j, i, 0] / (area * area), variance[j, i, 1] / (area * area)
            slope2[0, j, i] = (e * xu - b * yu) ** 2 * u2 + (e * xv - b * yv) ** 2 * v2
            slope2[1, j, i] = (a * yu - c * xu) ** 2 * u2 + (a * yv - c * xv) ** 2 * v2


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
    """The nodes' rays, interpolated to pixels (rows, cols).

    away: (2, rows, cols) LCD px, the nodes' position less R. lever (4, ...), by_slope (8, ...): of
    `lever_planes`. jacobian: (4, rows, cols) of the warp, LCD px per camera px.
    """

    away: Single
    lever: Single
    by_slope: Single
    jacobian: Single


def pixel_slopes(detail: Single, planes: Planes, variance: Single, start: Single) -> tuple[Single, Single]:
    """Slope and its variance, (2, rows, cols), rad and rad^2.

    detail: (rows, cols, 2) LCD px beyond the nodes' interpolated position. variance: (rows, cols, 2) of the
    displacement, px^2. start: (2, rows, cols) slope to begin with.
    """
    slope, slope2 = start.copy(), np.empty_like(start)
    _solve(detail, *planes, variance, slope, slope2)
    return slope, slope2
