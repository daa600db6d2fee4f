"""The optical lever per node: what a slope moves on the LCD and in the image, and what depth a pixel is."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
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
