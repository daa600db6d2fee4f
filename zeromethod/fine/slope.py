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

from zeromethod.arrays import Float, Ints, Single
from zeromethod.fine.lattice import PixelLattice, with_ghosts
from zeromethod.surface.lever import Lever

_PASSES = 3


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _solve(
    nodes: Single,
    row_first: Ints,
    row_weights: Float,
    col_first: Ints,
    col_weights: Float,
    detail: Single,
    variance: Single,
    slope: Single,
    slope2: Single,
) -> None:
    """Planes of the nodes (rows + 2, cols + 2, k), interpolated row by row, and slopes of the pixels."""
    rows, cols = detail.shape[0], detail.shape[1]
    planes = nodes.shape[2]
    line, at = np.empty((nodes.shape[1], planes), np.float32), np.empty(planes, np.float32)
    for j in range(rows):
        first = row_first[j]
        for i in range(nodes.shape[1]):
            for k in range(planes):
                line[i, k] = np.float32(0.0)
            for m in range(4):
                weight = np.float32(row_weights[j, m])
                for k in range(planes):
                    line[i, k] += weight * nodes[first + m, i, k]
        for i in range(cols):
            for k in range(planes):
                at[k] = np.float32(0.0)
            for m in range(4):
                weight = np.float32(col_weights[i, m])
                for k in range(planes):
                    at[k] += weight * line[col_first[i] + m, k]
            x, y = detail[j, i, 0] + at[0], detail[j, i, 1] + at[1]
            sx, sy = at[18], at[19]
            a = b = c = e = area = np.float32(0.0)
            for _ in range(_PASSES):
                ha, hb, hc, he = (
                    np.float32(0.5) * (at[6] * sx + at[10] * sy),
                    np.float32(0.5) * (at[7] * sx + at[11] * sy),
                    np.float32(0.5) * (at[8] * sx + at[12] * sy),
                    np.float32(0.5) * (at[9] * sx + at[13] * sy),
                )
                a, b, c, e = at[2] + ha, at[3] + hb, at[4] + hc, at[5] + he
                area = np.float32(1.0) / (a * e - b * c)
                sx, sy = (e * x - b * y) * area, (a * y - c * x) * area
            slope[0, j, i], slope[1, j, i] = sx, sy
            xu, xv, yu, yv = at[14], at[15], at[16], at[17]
            u2, v2 = variance[j, i, 0] * (area * area), variance[j, i, 1] * (area * area)
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
    nodes = np.moveaxis(with_ghosts(np.concatenate(planes)), 0, -1)
    slope, slope2 = (np.empty((2, *lattice.shape), np.float32) for _ in range(2))
    weights = *lattice.down, *lattice.across
    _solve(np.ascontiguousarray(nodes, np.float32), *weights, detail, variance, slope, slope2)
    return slope, slope2
