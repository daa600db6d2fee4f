"""What bends of the warp do to a still image: lens, pixels and the texture's specks average over them.

A lens of variance s^2 (camera px) that looks at q sees q + s^2/2 (d2q/du2 + d2q/dv2). Where in a speck the
displacement is that correlation finds depends on how the lens blurs it there, differently with each press:
up to half a speck from its middle. How much both move depth hangs on the texture and is not known; it goes
into sigma as what a blur of the warp, as wide as lens, pixel and half a speck together, changes.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.passive.matching import LIGHT_PX
from zeromethod.surface import Peak, Surface
from zeromethod.warp.warp import Warp


def speck_px2(grey: Image, noise_grey: float) -> float:
    """Squared size of the texture's specks, px^2: variance of grey over that of its slope.

    grey: (rows, cols). noise_grey: standard deviation of the grey levels' noise, which is taken out.
    """
    texture = np.asarray(grey, np.float64)
    texture = texture - cv2.GaussianBlur(texture, (0, 0), LIGHT_PX)
    noise = noise_grey**2
    slopes = [0.5 * (texture[2:, 1:-1] - texture[:-2, 1:-1]), 0.5 * (texture[1:-1, 2:] - texture[1:-1, :-2])]
    slope = float(np.mean([np.mean(one**2) for one in slopes])) - 0.5 * noise
    size2 = (float(np.mean(texture**2)) - noise) / max(slope, 1e-12)
    # Specks that the window takes for changes of brightness are not seen as texture.
    return float(np.clip(size2, 0.0, LIGHT_PX**2))


def blurred(warp: Warp, rest: Float, spacing_px: float, variance_px2: float) -> Warp:
    """The warp with its departure from rest blurred by that variance, camera px^2; the border stays as it is.

    rest: (rows, cols, 2) LCD px, at nodes spacing_px apart.
    """
    off = warp.q - rest
    bend = np.zeros_like(off)
    middle = off[1:-1, 1:-1]
    bend[1:-1, 1:-1] = off[2:, 1:-1] + off[:-2, 1:-1] + off[1:-1, 2:] + off[1:-1, :-2] - 4.0 * middle
    # Next to what is not valid, the bend is not known: that of the valid neighbours stands in.
    known = np.asarray(np.isfinite(bend).all(axis=-1))[..., None]
    weight = np.asarray(cv2.blur(known[..., 0].astype(np.float64), (3, 3)))[..., None]
    near = cv2.blur(np.where(known, bend, 0.0), (3, 3)) / np.maximum(weight, 1e-9)
    bend = np.where(known, bend, near)
    return replace(warp, q=warp.q + 0.5 * variance_px2 / spacing_px**2 * bend)


def with_bend(
    surface: Surface, summit: Peak | None, other: Surface, its: Peak | None
) -> tuple[Surface, Peak | None]:
    """Surface and peak with what `other`, read off the blurred warp, differs by in their sigma."""
    off = np.nan_to_num(np.abs(other.depth_mm - surface.depth_mm))
    surface = replace(surface, sigma_depth_mm=np.hypot(surface.sigma_depth_mm, off))
    if summit is not None and its is not None:
        sigma = float(np.hypot(summit.sigma_mm, its.depth_mm - summit.depth_mm))
        summit = replace(summit, sigma_mm=sigma)
    return surface, summit
