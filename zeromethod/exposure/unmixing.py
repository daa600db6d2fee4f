"""The residual of one picture's target from that of a mix: the mixture's bias taken out."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float

NO_BIAS_PX = 2e-3
"""Bias, a fifth of the noise, below which it is not interpolated at (u, v) + d."""

NEAR_PX = 0.05
"""Residual near which a moving target's phase, a period over the whole panel at most, is the node's own."""


@numba.njit(cache=True)
def _less(d: Float, bias: Float, out: Float) -> bool:
    """Take its bias out of a row of nodes (cols, 2); whether all of that is negligible."""
    large = 0
    for i in range(d.shape[0]):
        bu, bv = bias[i, 0], bias[i, 1]
        out[i, 0], out[i, 1] = d[i, 0] - bu, d[i, 1] - bv
        large += abs(bu) + abs(bv) > NO_BIAS_PX
    return large == 0


@numba.njit(cache=True)
def _unmix(d: Float, bias: Float, base: Float, per_px: float, out: Float) -> None:
    rows, cols = d.shape[0], d.shape[1]
    for j in range(rows):
        if base.shape[0] == 0 and _less(d[j], bias[j], out[j]):
            continue
        for i in range(cols):
            ou, ov = 0.0, 0.0
            bu, bv = bias[j, i, 0], bias[j, i, 1]
            steps = 3 if abs(bu) + abs(bv) > NO_BIAS_PX else 0
            if base.shape[0] > 0:
                ou, ov = base[j, i, 0], base[j, i, 1]
                bu, bv = bu - ou, bv - ov
                near = abs(d[j, i, 0]) + abs(d[j, i, 1]) <= NEAR_PX
                steps = 0 if near and abs(bu) + abs(bv) <= NO_BIAS_PX else 3
            for _ in range(steps):
                x = i + per_px * (d[j, i, 0] - bu)
                y = j + per_px * (d[j, i, 1] - bv)
                # positions outside the grid are clipped to its edge, NaN to node 0
                x = min(max(x, 0.0), cols - 1.001) if math.isfinite(x) else 0.0
                y = min(max(y, 0.0), rows - 1.001) if math.isfinite(y) else 0.0
                m, n = int(x), int(y)
                s, t = x - m, y - n
                w00, w01, w10, w11 = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
                u = w00 * bias[n, m, 0] + w01 * bias[n, m + 1, 0] - ou
                u += w10 * bias[n + 1, m, 0] + w11 * bias[n + 1, m + 1, 0]
                v = w00 * bias[n, m, 1] + w01 * bias[n, m + 1, 1] - ov
                v += w10 * bias[n + 1, m, 1] + w11 * bias[n + 1, m + 1, 1]
                settled = abs(u - bu) + abs(v - bv) < 1e-3
                bu, bv = u, v
                if settled:
                    break
            out[j, i, 0] = d[j, i, 0] - bu
            out[j, i, 1] = d[j, i, 1] - bv


_STILL = np.zeros((0, 0, 2))


def unmix(d: Float, bias_px: Float, spacing_px: float, target_px: Float | None = None) -> Float:
    """Residual against the mix from the sensor's, (rows, cols, 2) camera px: d - b((u, v) + d).

    At most three steps of fixed-point iteration, b linear between nodes; a negligible bias is the node's own.
    target_px: (rows, cols, 2) camera px, displacement of a moving target at each node (u, v), which the
    sensor has taken out of d there; the one at (u, v) + d is what belongs to it.
    """
    out = np.empty_like(d)
    if target_px is None:
        _unmix(d, bias_px, _STILL, 1 / spacing_px, out)
    else:
        _unmix(d, bias_px + target_px, target_px, 1 / spacing_px, out)
    return out
