"""Closed forms of a dent in its own frame: each returns (depth mm, d/dalong, d/dacross).

`along`, `across`: mm from the dent's centre. `depth_mm` is the peak depth and may have either sign.
Source of ball and cone: K. L. Johnson, Contact Mechanics, Cambridge 1985, sections 4.2 (Hertz) and 5.2
(Sneddon's cone), doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from zeromethod.arrays import Float
from zeromethod.simulation.spline import evaluate_line, evaluate_spline

Field = tuple[Float, Float, Float]


def gaussian(along: Float, across: Float, depth_mm: float, sigma_mm: float) -> Field:
    """Depth d0 exp(-r^2 / 2 sigma^2): a formula, which no pressure on rubber makes."""
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
    """Gaussian across, a box of `length_mm` blurred by the same sigma along; peak d0. No rubber makes it."""
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
    Samples may be what no rubber makes.
    """
    rows, cols = coefficients.shape
    middle_row, middle_col = (rows - 1) / 2, (cols - 1) / 2
    value, d_row, d_col = evaluate_spline(
        coefficients, across / pitch_mm + middle_row, along / pitch_mm + middle_col
    )
    return depth_mm * value, depth_mm / pitch_mm * d_col, depth_mm / pitch_mm * d_row


def radial(along: Float, across: Float, depth_mm: float, size_mm: float, table: Float) -> Field:
    """A dent round about its middle: d0 u D(u), u = 1 / sqrt(1 + r^2 / size^2), so that it reaches anywhere.

    table: (2, n + 2) `line_coefficients` of D and of G, with slope over r = d0 / size^2 u^3 G(u), at n places
    from u = 0, infinitely far away, to 1.
    """
    u = 1 / np.sqrt(1 + (along**2 + across**2) / size_mm**2)
    of_depth, of_slope = evaluate_line(table, u * (table.shape[1] - 3))
    return _radial(along, across, depth_mm * u * of_depth, depth_mm / size_mm**2 * u**3 * of_slope)


def whole_plane(along: Float, across: Float, depth_mm: float, size_mm: float, coefficients: Float) -> Field:
    """Interpolate a map whose columns and rows lie evenly in w = x / sqrt(size^2 + x^2), -1 to 1.

    It is dense in its middle and reaches anywhere. coefficients: of `scipy.ndimage.spline_filter`.
    """
    at, by = [], []
    for x, count in ((across, coefficients.shape[0]), (along, coefficients.shape[1])):
        turn = 1 / np.sqrt(1 + (x / size_mm) ** 2)
        at.append(0.5 * (count - 1) * (1 + x / size_mm * turn))
        by.append(0.5 * (count - 1) * turn**3 * depth_mm / size_mm)
    value, d_row, d_col = evaluate_spline(coefficients, *at)
    return depth_mm * value, by[1] * d_col, by[0] * d_row
