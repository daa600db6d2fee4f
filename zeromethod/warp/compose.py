"""Composition of the shown warp with the residual: the measured warp."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.warp.interpolant import sample_pair


@numba.njit(cache=True, fastmath={"contract"})
def _compose(q_shown: Float, d_px: Float, scale: float, out: Float) -> None:
    rows, cols = out.shape[0], out.shape[1]
    for j in range(rows):
        for i in range(cols):
            x, y = sample_pair(q_shown, i + scale * d_px[j, i, 0], j + scale * d_px[j, i, 1])
            out[j, i, 0] = x
            out[j, i, 1] = y


def compose(q_shown: Float, d_px: Float, spacing_px: float) -> Float:
    """Measured warp q(u, v) = q_shown((u, v) + d) at every node.

    q_shown: (rows, cols, 2) LCD px, the warp shown during the exposure. d_px: (rows, cols, 2) residual in
    camera px. spacing_px: camera px between nodes. Returns (rows, cols, 2) LCD px; NaN where (u, v) + d
    leaves the interpolable region (one node inside the grid's edge) or d is NaN. With d = 0 the inner nodes
    come back bit for bit.

    Convention: the residual is where on the target the node looks, observed(u, v) = T((u, v) + d).
    """
    out = np.empty_like(q_shown)
    _compose(q_shown, d_px, 1.0 / spacing_px, out)
    return out
