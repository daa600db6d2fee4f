"""Composition of the shown warp with the residual: the measured warp."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.kernels import kernel, read
from zeromethod.warp.interpolant import sample_pair


@kernel(
    read(numba.float64, 3), read(numba.float64, 3), numba.float64, numba.float64[:, :, ::1],
    fastmath={"contract"},
)  # fmt: skip
def _compose(q_shown: Float, d_px: Float, scale: float, out: Float) -> None:
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            col, row = i + scale * d_px[j, i, 0], j + scale * d_px[j, i, 1]
            out[j, i, 0], out[j, i, 1] = sample_pair(q_shown, col, row)


def compose(q_shown: Float, d_px: Float, spacing_px: float) -> Float:
    """Measured warp q(u, v) = q_shown((u, v) + d) at every node.

    q_shown: (rows, cols, 2) LCD px, the warp shown during the exposure. d_px: (rows, cols, 2) residual in
    camera px. spacing_px: camera px between nodes. Returns (rows, cols, 2) LCD px; NaN where (u, v) + d
    leaves the interpolable region (one node inside the grid's edge) or d is NaN. With d = 0 the inner nodes
    come back bit for bit.

    Convention: the residual is where on the target the node looks, observed(u, v) = T((u, v) + d).
    """
    out = np.empty(q_shown.shape)
    _compose(q_shown, d_px, 1.0 / spacing_px, out)
    return out
