"""Cubic B-splines through samples on a line or a lattice, as shaders evaluate them (bench_spline.glsl).

Source: Unser, Aldroubi, Eden 1993, doi:10.1109/78.193220.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.ndimage import spline_filter
from scipy.sparse import diags_array

from zeromethod.arrays import Float

MARGIN = 12
"""Zeros put round the map; the spline's ringing falls by 0.268 per sample, so 1e-7 is left there."""


def spline_coefficients(samples: NDArray[np.floating]) -> Float:
    """B-spline coefficients (rows + 2 MARGIN, cols + 2 MARGIN) of `samples` continued by zeros.

    The spline passes through every sample; sample (row, col) belongs to coefficient
    (row + MARGIN, col + MARGIN).
    """
    padded = np.pad(np.asarray(samples, dtype=np.float64), MARGIN)
    return np.asarray(spline_filter(padded, order=3, mode="mirror"), dtype=np.float64)


def _values(t: Float) -> tuple[Float, Float, Float, Float]:
    s, t2 = 1.0 - t, t * t
    s2 = s * s
    return s2 * s / 6, 2 / 3 - t2 * (2 - t) / 2, 2 / 3 - s2 * (2 - s) / 2, t2 * t / 6


def spline_weights(t: Float) -> tuple[Float, Float]:
    """(values, derivatives), each (..., 4): B-spline weights of the four samples round a point."""
    s = 1.0 - t
    values = np.stack(_values(t), axis=-1)
    slopes = np.stack((-(s**2) / 2, t * (1.5 * t - 2), s * (2 - 1.5 * s), t**2 / 2), axis=-1)
    return values, slopes


def evaluate_spline(coefficients: Float, row: Float, col: Float) -> tuple[Float, Float, Float]:
    """(value, d/drow, d/dcol) at coefficient coordinates (sample + MARGIN); 0 beyond the padded map."""
    rows, cols = coefficients.shape
    row, col = np.broadcast_arrays(np.asarray(row, dtype=np.float64), np.asarray(col, dtype=np.float64))
    inside = (row >= 1) & (row < rows - 2) & (col >= 1) & (col < cols - 2)
    row, col = np.where(inside, row, 1.0), np.where(inside, col, 1.0)
    i, j = np.floor(row).astype(np.intp), np.floor(col).astype(np.intp)
    by_row, by_row_slope = spline_weights(row - i)
    by_col, by_col_slope = spline_weights(col - j)
    offsets = np.arange(-1, 3)
    patch = coefficients[(i[..., None] + offsets)[..., :, None], (j[..., None] + offsets)[..., None, :]]
    along = np.einsum("...ij,...j->...i", patch, by_col)
    value = np.einsum("...i,...i->...", along, by_row)
    d_row = np.einsum("...i,...i->...", along, by_row_slope)
    d_col = np.einsum("...ij,...i,...j->...", patch, by_row, by_col_slope)
    return np.where(inside, value, 0.0), np.where(inside, d_row, 0.0), np.where(inside, d_col, 0.0)


def line_coefficients(samples: Float) -> Float:
    """Cubic B-spline coefficients (n + 2, ...) along the first axis through `samples` (n, ...).

    The third derivative runs on through the second and the last but one sample.
    """
    n = len(samples)
    matrix = diags_array([1 / 6, 4 / 6, 1 / 6], offsets=[-1, 0, 1], shape=(n + 2, n + 2)).tolil()
    matrix[0, :5] = [1, -4, 6, -4, 1]
    matrix[n + 1, n - 3 :] = [1, -4, 6, -4, 1]
    ends = np.zeros((1, *samples.shape[1:]))
    solved: Float = scipy.sparse.linalg.splu(matrix.tocsc()).solve(np.concatenate([ends, samples, ends]))
    return solved


def evaluate_line(coefficients: Float, at: Float) -> Float:
    """(k, ...) values at places 0 <= at <= n - 1 of splines (k, n + 2) of `line_coefficients`; NaN at NaN."""
    cell = np.nan_to_num(np.clip(np.floor(at), 0, coefficients.shape[1] - 4)).astype(np.intp)
    weights = _values(at - cell)
    return np.asarray(sum(coefficients.take(cell + k, axis=1) * weight for k, weight in enumerate(weights)))
