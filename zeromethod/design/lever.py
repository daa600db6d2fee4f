"""The optical lever per node: what a slope moves on the LCD and in the image, and what depth a pixel is."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.design.sampled_view import SampledView, inverse


def lcd_px_per_mrad(view: SampledView) -> Float:
    """How far a slope along x, along y moves the reading on the LCD, (rows, cols, 2), LCD px per mrad."""
    result: Float = 1e-3 * np.linalg.norm(view.sensitivity, axis=-2)
    return result


def camera_px_per_mrad(view: SampledView) -> Float:
    """The same in the camera's image (open loop, to first order), (rows, cols, 2), camera px per mrad."""
    result: Float = 1e-3 * np.linalg.norm(inverse(view.lcd_per_camera) @ view.sensitivity, axis=-2)
    return result


def mirror_mm_per_px(view: SampledView) -> Float:
    """Mirror along x, along y that one camera pixel covers, (rows, cols, 2), mm."""
    with np.errstate(divide="ignore"):
        result: Float = 1.0 / np.linalg.norm(inverse(view.mirror_per_camera), axis=-2)
    return result


def depth_nm_per_px(view: SampledView) -> Float:
    """Depth that moves the image by one camera pixel, (rows, cols, 2), nm.

    It is the difference of depth between two points of the mirror one camera pixel apart, along x or along y,
    that turns the mirror between them by the slope that moves the image by one camera pixel.
    """
    with np.errstate(divide="ignore"):
        result: Float = 1e6 * mirror_mm_per_px(view) * 1e-3 / camera_px_per_mrad(view)
    return result


GAUSSIAN_RING = 2.0 * np.exp(-1.5)
"""Largest concave curvature of a Gaussian, on the ring at sqrt(3) sigma, in units of depth / sigma^2."""
LOAD_RING = 0.357769
"""The same of a load on a half-space, exp(-u) I0(u), u = r^2 / 4 width^2, in units of depth / 2 width^2."""


def bending(view: SampledView) -> Float:
    """1 / curvature of depth at which the node folds, by its direction: e' b e, (rows, cols, 2, 2), mm."""
    by_point = view.lcd_per_camera @ inverse(view.mirror_per_camera)
    whole = -inverse(by_point) @ view.sensitivity
    result: Float = 0.5 * (whole + np.swapaxes(whole, -1, -2))
    return result


def largest_curvature_per_mm(view: SampledView) -> Float:
    """Curvature of depth, in its worst direction, at which the node folds, (rows, cols), 1/mm.

    A mirror of curvature k along a unit vector e changes dq/dp by k (dq/dslope) e e', whose determinant
    vanishes at k = -1 / (e' (dq/dp)^-1 (dq/dslope) e). For a flat mirror that is
    cos(incidence) / (2 path) in the plane of incidence and 1 / (2 path cos(incidence)) across, the path
    as long as if it were all in rubber. Curvature counts as positive where the mirror is concave towards
    the rubber (the ring round a dent). Infinite where no such curvature folds.
    """
    bends = bending(view)
    known: Mask = np.asarray(np.isfinite(bends).all(axis=(-1, -2)))
    largest = np.linalg.eigvalsh(np.where(known[..., None, None], bends, 0.0))[..., -1]
    with np.errstate(divide="ignore"):
        result = np.where(largest > 0.0, 1.0 / largest, np.inf)
    return np.where(known & view.on_lcd, result, np.nan)


def gaussian_fold_mm(view: SampledView, sigma_mm: float) -> Float:
    """Depth of a Gaussian press whose ring folds, the lever even over the press, (rows, cols), mm."""
    result: Float = largest_curvature_per_mm(view) * sigma_mm**2 / GAUSSIAN_RING
    return result


def load_fold_mm(view: SampledView, width_mm: float) -> Float:
    """The same of a load, whose dent has the curvature d0 / 2 width^2 in its middle."""
    result: Float = largest_curvature_per_mm(view) * 2 * width_mm**2 / LOAD_RING
    return result
