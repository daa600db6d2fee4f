"""The residual of one picture's target from that of a mix: the mixture's bias taken out."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.exposure.target_phase import TargetPhase
from zeromethod.warp.grid import NodeGrid

NO_BIAS_PX = 2e-3
"""Bias, a fifth of the noise, below which it is not interpolated at (u, v) + d."""

NEAR_PX = 0.05
"""Residual near which a moving target's phase, a period over the whole panel at most, is the node's own."""


@numba.njit(cache=True)
def _less(d: Float, bias: Float, near_px: float, out: Float) -> bool:
    """Take its bias out of a row of nodes (cols, 2); whether that is all there is to do."""
    more = 0
    for i in range(d.shape[0]):
        du, dv, bu, bv = d[i, 0], d[i, 1], bias[i, 0], bias[i, 1]
        out[i, 0], out[i, 1] = du - bu, dv - bv
        more += (abs(bu) + abs(bv) > NO_BIAS_PX) | (abs(du) + abs(dv) > near_px)
    return more == 0


@numba.njit(cache=True, inline="always")
def _displaced(rad: Float, px_per_rad: float, diagonal: bool) -> tuple[float, float]:
    """(u, v) camera px: phases of the two carriers (2,) as a displacement."""
    a, b = px_per_rad * rad[0], px_per_rad * rad[1]
    return (0.5 * (a + b), 0.5 * (a - b)) if diagonal else (a, b)


@numba.njit(cache=True)
def _unmix(
    d: Float, bias: Float, rad: Float, px_per_rad: float, diagonal: bool, per_px: float, out: Float
) -> None:
    """Fill `out` with what `unmix` returns. rad: (0, 0, 2) of a target that stands."""
    rows, cols = d.shape[0], d.shape[1]
    moving = rad.shape[0] > 0
    near_px = NEAR_PX if moving else math.inf
    for j in range(rows):
        if _less(d[j], bias[j], near_px, out[j]):
            continue
        for i in range(cols):
            du, dv = d[j, i, 0], d[j, i, 1]
            bu, bv = bias[j, i, 0], bias[j, i, 1]
            if abs(bu) + abs(bv) <= NO_BIAS_PX and abs(du) + abs(dv) <= near_px:
                continue
            ou, ov = _displaced(rad[j, i], px_per_rad, diagonal) if moving else (0.0, 0.0)
            for _ in range(3):
                x = i + per_px * (du - bu)
                y = j + per_px * (dv - bv)
                # positions outside the grid are clipped to its edge, NaN to node 0
                x = min(max(x, 0.0), cols - 1.001) if math.isfinite(x) else 0.0
                y = min(max(y, 0.0), rows - 1.001) if math.isfinite(y) else 0.0
                m, n = int(x), int(y)
                s, t = x - m, y - n
                u, v = -ou, -ov
                for corner in range(4):
                    right, below = corner & 1, corner >> 1
                    weight = (s if right else 1 - s) * (t if below else 1 - t)
                    u += weight * bias[n + below, m + right, 0]
                    v += weight * bias[n + below, m + right, 1]
                    if moving:
                        tu, tv = _displaced(rad[n + below, m + right], px_per_rad, diagonal)
                        u += weight * tu
                        v += weight * tv
                settled = abs(u - bu) + abs(v - bv) < 1e-3
                bu, bv = u, v
                if settled:
                    break
            out[j, i, 0] = du - bu
            out[j, i, 1] = dv - bv


_STILL = np.zeros((0, 0, 2))


def unmix(d: Float, bias_px: Float, grid: NodeGrid, target: TargetPhase | None = None) -> Float:
    """Residual against the mix from the sensor's, (rows, cols, 2) camera px: d - b((u, v) + d).

    At most three steps of fixed-point iteration, b linear between nodes; a negligible bias is the node's own.
    target: that moves, whose phase at each node (u, v) the sensor has taken out of d there; the one at
    (u, v) + d is what belongs to it.
    """
    out = np.empty_like(d)
    rad, diagonal = (_STILL, False) if target is None else (target.node_rad, target.diagonal)
    _unmix(d, bias_px, rad, grid.period_px / (2 * math.pi), diagonal, 1 / grid.spacing_px, out)
    return out


@numba.njit(cache=True)
def _gained(modulation: Single, at_nodes: Float, out: Single) -> None:
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[j, i, 0] = modulation[j, i, 0] * at_nodes[j, i, 2]
            out[j, i, 1] = modulation[j, i, 1] * at_nodes[j, i, 3]


def at_full_contrast(modulation: Single, target: TargetPhase) -> Single:
    """Modulation (rows, cols, 2) that the nodes would have if the target stood."""
    out = np.empty_like(modulation)
    _gained(modulation, target.at_nodes, out)
    return out
