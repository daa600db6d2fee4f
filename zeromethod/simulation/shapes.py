"""Closed forms of a dent in its own frame: each returns (depth mm, d/dalong, d/dacross).

`along`, `across`: mm from the dent's centre. `depth_mm` is the peak depth and may have either sign.
Source of ball and cone: K. L. Johnson, Contact Mechanics, Cambridge 1985, sections 4.2 (Hertz) and 5.2
(Sneddon's cone), doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import spline_filter
from scipy.special import erf

from zeromethod.arrays import Float

Field = tuple[Float, Float, Float]


def gaussian(along: Float, across: Float, depth_mm: float, sigma_mm: float) -> Field:
    """Soft pad: d = d0 exp(-r^2 / 2 sigma^2)."""
    depth = depth_mm * np.exp(-(along**2 + across**2) / (2 * sigma_mm**2))
    return depth, -along / sigma_mm**2 * depth, -across / sigma_mm**2 * depth


def _radial(along: Float, across: Float, depth: Float, by_r_over_r: Float) -> Field:
    """Field of a radially symmetric depth from its (dd/dr) / r."""
    return depth, along * by_r_over_r, across * by_r_over_r


def ball(along: Float, across: Float, depth_mm: float, radius_mm: float) -> Field:
    """Hertz: a = sqrt(R d0); d0 - r^2 / 2R where it touches, falling like 1/r far away.

    Outside: d0 / (pi a^2) [(2 a^2 - r^2) asin(a/r) + a sqrt(r^2 - a^2)].
    """
    a = np.sqrt(radius_mm * abs(depth_mm))
    r = np.hypot(along, across)
    inside = r <= a
    q = np.where(inside, a, r)
    angle, root = np.arcsin(a / q), np.sqrt(np.maximum(q * q - a * a, 0.0))
    scale = depth_mm / (np.pi * a * a)
    depth = np.where(
        inside, depth_mm * (1 - r * r / (2 * a * a)), scale * ((2 * a * a - q * q) * angle + a * root)
    )
    over_r = np.where(inside, -depth_mm / (a * a), 2 * scale * (a * root / (q * q) - angle))
    return _radial(along, across, depth, over_r)


def cone(along: Float, across: Float, depth_mm: float, contact_mm: float) -> Field:
    """Sneddon: e = 2 d0 / (pi a); d0 - e r where it touches, e [a asin(a/r) + sqrt(r^2 - a^2) - r] beyond.

    The slope at the very tip, where it has no direction, is 0.
    """
    a = contact_mm
    steepness = 2 * depth_mm / (np.pi * a)
    r = np.hypot(along, across)
    inside = r <= a
    q = np.where(inside, a, r)
    root = np.sqrt(np.maximum(q * q - a * a, 0.0))
    depth = np.where(inside, depth_mm - steepness * r, steepness * (a * np.arcsin(a / q) + root - q))
    by_r = np.where(inside, -steepness, steepness * (root / q - 1))
    over_r = np.divide(by_r, r, out=np.zeros_like(r), where=r > 0)
    return _radial(along, across, depth, over_r)


def edge(along: Float, across: Float, depth_mm: float, sigma_mm: float, length_mm: float) -> Field:
    """Straight edge: Gaussian across, a box of `length_mm` blurred by the same sigma along; peak d0."""
    scale = np.sqrt(2) * sigma_mm
    norm = depth_mm * 0.5 / erf(length_mm / (2 * scale))
    plus, minus = (along + length_mm / 2) / scale, (along - length_mm / 2) / scale
    profile = norm * (erf(plus) - erf(minus))
    by_along = norm * 2 / (np.sqrt(np.pi) * scale) * (np.exp(-(plus**2)) - np.exp(-(minus**2)))
    cross = np.exp(-(across**2) / (2 * sigma_mm**2))
    return profile * cross, by_along * cross, -across / sigma_mm**2 * profile * cross


def height_map(along: Float, across: Float, depth_mm: float, pitch_mm: float, coefficients: Float) -> Field:
    """Interpolate a sampled map, centred, columns along and rows across; C2 spline, 0 beyond its border.

    `coefficients`: from `zeromethod.simulation.spline.spline_coefficients`.
    """
    rows, cols = coefficients.shape
    middle_row, middle_col = (rows - 1) / 2, (cols - 1) / 2
    value, d_row, d_col = evaluate_spline(
        coefficients, across / pitch_mm + middle_row, along / pitch_mm + middle_col
    )
    return depth_mm * value, depth_mm / pitch_mm * d_col, depth_mm / pitch_mm * d_row


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
