"""What single pixels see beyond the nodes: LCD positions of pixels less those interpolated between nodes."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.warp.interpolant import sample_pair, window_matched


@numba.njit(cache=True)
def _looked_at(
    drawn: Float, first_col: float, first_row: float, per_px: float, d: Single, level: Float, out: Single
) -> None:
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            col = first_col + per_px * (i + d[j, i, 0])
            row = first_row + per_px * (j + d[j, i, 1])
            x, y = sample_pair(drawn, col, row)
            out[j, i, 0] = x - level[0, j, i]
            out[j, i, 1] = y - level[1, j, i]


def pixel_detail(shown: Float, d: Single, level: Float, padding: int, spacing_px: int) -> Single:
    """LCD position (rows, cols, 2) of pixels less a level (2, rows, cols), px; NaN off the drawn picture.

    shown: (node rows, node cols, 2) warp whose window-matched interpolant was drawn. d: (rows, cols, 2)
    camera px, the pixels' displacement; pixel (0, 0) is the node (padding, padding).

    Convention: a pixel looks at shown((u, v) + d).
    """
    drawn = np.empty(shown.shape, np.float32)
    window_matched(shown, drawn)
    out = np.empty(d.shape, np.float32)
    _looked_at(drawn.astype(np.float64), padding, padding, 1.0 / spacing_px, d, level, out)
    return out
