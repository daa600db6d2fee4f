"""Twice continuously differentiable interpolation of a sampled height map (cubic B-spline)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import spline_filter

from zeromethod.arrays import Float

MARGIN = 12
"""Zeros put round the map; the spline's ringing falls by 0.268 per sample, so 1e-7 is left there."""


def spline_coefficients(samples: NDArray[np.floating]) -> Float:
    """B-spline coefficients (rows + 2 MARGIN, cols + 2 MARGIN) of `samples` continued by zeros.

    The spline passes through every sample; sample (row, col) belongs to coefficient
    (row + MARGIN, col + MARGIN). Source: Unser, Aldroubi, Eden 1993, doi:10.1109/78.193220.
    """
    padded = np.pad(np.asarray(samples, dtype=np.float64), MARGIN)
    return np.asarray(spline_filter(padded, order=3, mode="mirror"), dtype=np.float64)


def spline_weights(t: Float) -> tuple[Float, Float]:
    """(values, derivatives), each (..., 4): B-spline weights of the four samples round a point."""
    s = 1.0 - t
    values = np.stack((s**3 / 6, 2 / 3 - t**2 * (2 - t) / 2, 2 / 3 - s**2 * (2 - s) / 2, t**3 / 6), axis=-1)
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
