"""The finest detail of the mirror that is resolved: the lens's aperture, the sensing window, the pixel.

The camera is focused on the LCD's image, not on the mirror: the cone of light of one camera pixel still has a
width where it meets the mirror, and the slope is averaged over it. That is for good; what the sensing window
averages in one frame the closed loop recovers with more frames, down to about the carrier's period.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import j1

from zeromethod.arrays import Float
from zeromethod.design.lever import mirror_mm_per_px
from zeromethod.design.sampled_view import SampledView, inverse, median_over
from zeromethod.optics import Optics

ASSUMED_PUPIL_MM = 5.0
"""Diameter of the lens's entrance pupil where none is given: a lens of 40 mm at f/8."""

_STEP_MM = 0.5
_HALF = 0.5


def footprint_mm(view: SampledView, pupil_mm: float) -> Float:
    """Extent along x, along y of the pupil's footprint on the mirror, (rows, cols, 2), mm.

    From how the mirror point moves with the point of the pupil along the image's u and v, the LCD point
    fixed: a flat mirror at distance a from the camera and b from the LCD, both divided by the index on the
    way, gives b / (a + b), and that over cos(incidence) along x.
    """
    moved_point, moved_q = [], []
    camera = view.optics.camera
    for axis in (camera.u_axis, camera.v_axis):
        ends = []
        for sign in (1, -1):
            position = camera.position + sign * _STEP_MM * axis
            optics = Optics(view.rig.replace({"camera.position_mm": position}))
            ends.append(optics.trace(view.u_px, view.v_px, optics.rest))
        moved_point.append((ends[0].point - ends[1].point)[..., :2] / (2 * _STEP_MM))
        moved_q.append((ends[0].q - ends[1].q) / (2 * _STEP_MM))
    point, q = np.stack(moved_point, axis=-1), np.stack(moved_q, axis=-1)
    # the pixel that still sees the same LCD point, through the moved point of the pupil
    pixel = -inverse(view.lcd_per_camera) @ q
    result: Float = pupil_mm * np.linalg.norm(point + view.mirror_per_camera @ pixel, axis=-1)
    return result


def resolution(view: SampledView, pupil_mm: float) -> dict[str, Any]:
    """Medians over the view, [along x, along y] in mm, and wavelengths of which half of the slope is left.

    aperture_wavelength_mm: for good (a uniform disc); frame_wavelength_mm: in one frame, with the window and
    the lens's blur.
    """
    period = view.rig.target.period_px
    per_px = np.array(median_over(mirror_mm_per_px(view), view.on_lcd))
    width = np.array(median_over(footprint_mm(view, pupil_mm), view.on_lcd))
    return {
        "pupil_mm": pupil_mm,
        "mirror_mm_per_px": per_px.tolist(),
        "footprint_mm": width.tolist(),
        "window_mm": (period * per_px).tolist(),
        "node_spacing_mm": (view.grid.spacing_px * per_px).tolist(),
        "aperture_wavelength_mm": [_half_wavelength(0.0, w, 0.0) for w in width],
        "frame_wavelength_mm": [
            _half_wavelength(period * mm, w, view.rig.camera.psf_px * mm)
            for mm, w in zip(per_px, width, strict=True)
        ],
    }


def _half_wavelength(window_mm: float, disc_mm: float, blur_mm: float) -> float:
    """Wavelength, mm, of which triangle window, disc and Gaussian together let half through."""
    widest = max(window_mm, disc_mm, blur_mm)
    if widest <= 0.0:
        return 0.0

    def passed(frequency: float) -> float:
        x = np.pi * disc_mm * frequency
        disc = 2 * j1(x) / x if x > 0 else 1.0
        lens = np.exp(-2 * (np.pi * blur_mm * frequency) ** 2)
        return float(np.sinc(window_mm * frequency) ** 2 * disc * lens) - _HALF

    return 1.0 / float(brentq(passed, 1e-9 / widest, 1.0 / widest))
