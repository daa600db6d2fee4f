"""The residual of one picture's target from that of a mix: the mixture's bias taken out."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.exposure.target_phase import TargetPhase
from zeromethod.kernels import kernel, read
from zeromethod.warp.grid import NodeGrid

NO_BIAS_PX = 2e-3
"""Bias, a fifth of the noise, below which it is not interpolated at (u, v) + d."""

NEAR_PX = 0.05
"""Residual near which a moving target's phase, a period over the whole panel at most, is the node's own."""


@kernel(
    read(numba.float64, 3),
    read(numba.float64, 3),
    read(numba.float64, 3),
    numba.float64,
    numba.float64,
    numba.float64[:, :, ::1],
)
def _unmix(d: Float, bias: Float, own: Float, near_px: float, per_px: float, out: Float) -> None:
    """Fill `out` with what `unmix` returns. own: bias and, of a target that moves, its phase, camera px."""
    rows, cols = d.shape[0], d.shape[1]
    for j in range(rows):
        for i in range(cols):
            du, dv, bu, bv = d[j, i, 0], d[j, i, 1], bias[j, i, 0], bias[j, i, 1]
            out[j, i, 0], out[j, i, 1] = du - bu, dv - bv
            if abs(bu) + abs(bv) <= NO_BIAS_PX and abs(du) + abs(dv) <= near_px:
                continue
            ou, ov = own[j, i, 0] - bu, own[j, i, 1] - bv
            for _ in range(3):
                x, y = i + per_px * (du - bu), j + per_px * (dv - bv)
                # positions outside the grid are clipped to its edge, NaN to node 0
                x = min(max(x, 0.0), cols - 1.001) if math.isfinite(x) else 0.0
                y = min(max(y, 0.0), rows - 1.001) if math.isfinite(y) else 0.0
                m, n = int(x), int(y)
                s, t = x - m, y - n
                u, v = -ou, -ov
                for corner in range(4):
                    right, below = corner & 1, corner >> 1
                    weight = (s if right else 1 - s) * (t if below else 1 - t)
                    u += weight * own[n + below, m + right, 0]
                    v += weight * own[n + below, m + right, 1]
                settled = abs(u - bu) + abs(v - bv) < 1e-3
                bu, bv = u, v
                if settled:
                    break
            out[j, i, 0], out[j, i, 1] = du - bu, dv - bv


def unmix(d: Float, bias_px: Float, grid: NodeGrid, target: TargetPhase | None = None) -> Float:
    """Residual against the mix from the sensor's, (rows, cols, 2) camera px: d - b((u, v) + d).

    At most three steps of fixed-point iteration, b linear between nodes; a negligible bias is the node's own.
    target: that moves, whose phase at each node (u, v) the sensor has taken out of d there; the one at
    (u, v) + d is what belongs to it.
    """
    out, near_px, own = np.empty_like(d), math.inf, bias_px
    if target is not None:
        near_px, own = NEAR_PX, bias_px + _displaced(target, grid.period_px / (2 * math.pi))
    _unmix(d, bias_px, own, near_px, 1 / grid.spacing_px, out)
    return out


def _displaced(target: TargetPhase, px_per_rad: float) -> Float:
    """(rows, cols, 2) camera px along u and v: phases of the target's two carriers as a displacement."""
    along = px_per_rad * target.node_rad
    if not target.diagonal:
        return along
    a, b = along[..., 0], along[..., 1]
    return np.stack([0.5 * (a + b), 0.5 * (a - b)], axis=-1)


def at_full_contrast(modulation: Single, target: TargetPhase) -> Single:
    """Modulation (rows, cols, 2) that the nodes would have if the target stood."""
    return (modulation * target.at_nodes[..., 2:]).astype(np.float32)
