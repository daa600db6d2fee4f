"""The noise of one frame's reading in pixels, slope and depth, and what averaging makes of it.

Grey levels follow from the rig file: white of the LCD at `simulation.peak_grey_share` of the camera's full
scale (an exposure set so for a real camera), times the mirror's reflectance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.design.sampled_view import SampledView, inverse, median_over
from zeromethod.design.tir import reflectance
from zeromethod.errors import InputError
from zeromethod.pattern.target import Target
from zeromethod.rig.model import Rig
from zeromethod.sensing.window import carrier_power, transfer
from zeromethod.surface import SurfaceReader
from zeromethod.warp.warp import Warp

FRAMES = (1, 10, 100, 1000)
"""Numbers of frames whose mean is given."""

_SAMPLES = 64
"""Samples per period of a periodic target."""


@dataclass(frozen=True)
class Contrast:
    """The target in the camera's image, in shares of the light of a white LCD.

    mean: its light. gradient: rms of d(light)/du over the waves that are measured, per camera px. carrier:
    amplitude of one such wave (of a noise target: of all together).
    """

    mean: float
    gradient: float
    carrier: float


def contrast(rig: Rig) -> Contrast:
    """Target of a rig behind the lens's blur and the camera pixel's own width."""
    period, target = rig.target.period_px, Target.from_spec(rig.target)
    noise = target.kind == "noise"
    size = target.texture.shape[0] if noise else _SAMPLES
    step = 1.0 if noise else period / _SAMPLES
    v, u = np.meshgrid(step * np.arange(size), step * np.arange(size), indexing="ij")
    waves = np.fft.fft2(target.light(u, v)) / size**2
    fv, fu = np.meshgrid(np.fft.fftfreq(size, step), np.fft.fftfreq(size, step), indexing="ij")
    lens = np.exp(-2 * (np.pi * rig.camera.psf_px) ** 2 * (fu**2 + fv**2)) * np.sinc(fu) * np.sinc(fv)
    order = np.rint(period * np.abs(fu)), np.rint(period * np.abs(fv))
    if noise:
        used = fu**2 + fv**2 > 0
    elif target.kind == "checker":
        used = (order[0] == 1) & (order[1] == 1)
    else:
        used = order[0] + order[1] == 1
    left = np.where(used, np.abs(waves * lens), 0.0)
    return Contrast(
        mean=float(waves[0, 0].real),
        gradient=float(np.sqrt(np.sum((2 * np.pi * fu * left) ** 2))),
        carrier=float(np.sqrt(np.sum(left**2)) if noise else 2 * left.max()),
    )


def drawn_share(view: SampledView) -> Float:
    """Share of the carrier's amplitude that the LCD's lit apertures leave, mean of u and v, (rows, cols)."""
    per_lcd = inverse(view.lcd_per_camera) / view.rig.target.period_px  # cycles per LCD px of u, of v
    fill = np.array(view.rig.display.fill_factor)
    result: Float = np.mean(np.prod(np.sinc(per_lcd * fill), axis=-1), axis=-1)
    return result


def displacement_sigma_px(view: SampledView) -> Float:
    """Standard deviation of one frame's displacement along u or v, (rows, cols), camera px.

    sigma = s sqrt(sum w^2) / rms(dI/du), w the sensing window, s^2 = read^2 + light / electrons + 1/12 in
    grey^2. That is the Cramer-Rao bound in that window, which the carrier estimator meets.
    """
    rig, image = view.rig, contrast(view.rig)
    noise = rig.camera.noise
    white = rig.simulation.peak_grey_share * (2**rig.camera.bits - 1) - noise.black_grey
    light = white * reflectance(view)
    electrons = noise.electrons_per_grey
    variance = noise.read_grey**2 + 1 / 12 + (image.mean * light / electrons if electrons else 0.0)
    weight = carrier_power(rig.target.period_px)[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        result: Float = weight * np.sqrt(variance) / (image.gradient * light * drawn_share(view))
    return result


def slope_sigma_urad(view: SampledView) -> Float:
    """Standard deviation of one frame's slope along x, along y, (rows, cols, 2), microradian."""
    per_px = np.linalg.norm(inverse(view.sensitivity) @ view.lcd_per_camera, axis=-1)
    result: Float = 1e6 * per_px * displacement_sigma_px(view)[..., None]
    return result


def depth_sigma_nm(view: SampledView) -> Float:
    """Standard deviation of one frame's depth, anchored as the rig says, (rows, cols), nm.

    What the surface reader states of a mirror at rest. NaN where it reads nothing; where it refuses the view
    altogether, everywhere.
    """
    grid = view.grid
    q = np.full((*grid.shape, 2), np.nan)
    sigma = np.full((*grid.shape, 2), np.nan)
    q[grid.inner] = view.trace.q
    by_camera = np.linalg.norm(view.lcd_per_camera, axis=-1)
    sigma[grid.inner] = by_camera * displacement_sigma_px(view)[..., None]
    flags = np.ones(grid.shape, np.uint16)
    flags[grid.inner] = ~view.on_lcd
    try:
        reader = SurfaceReader(view.rig, view.optics, grid)
    except InputError:
        return np.full(view.on_lcd.shape, np.nan)
    surface = reader.read(Warp(q, sigma, flags, 0))
    return 1e6 * surface.sigma_depth_mm[grid.inner]


def grid_bias_px(view: SampledView) -> Float:
    """Bound of the bias that the LCD's own pixels beat into a displacement, (rows, cols), camera px.

    An LCD pixel shows one grey over its lit aperture (three where it is striped), so that its light has whole
    waves per pixel, and the carrier beside them. What of these the lens and the camera's pixel let through
    folds back at the camera's pixels; the sensing window passes what comes near the carrier. Every phase is
    taken as the worst. Averaging does not take it away; a movement of the reading over an LCD pixel turns it.
    """
    rig, period, blur = view.rig, view.rig.target.period_px, view.rig.camera.psf_px
    target = contrast(rig)
    drawn = target.carrier / (np.exp(-2 * (np.pi * blur / period) ** 2) * np.sinc(1 / period))
    carriers = np.moveaxis(inverse(view.lcd_per_camera), -2, 0) / period  # cycles per LCD px of u, of v
    sides = [(sign * one, drawn) for one in carriers for sign in (-1, 1)]
    striped = rig.display.stripes == "rgb"
    fill = np.array(rig.display.fill_factor) / (3 if striped else 1, 1)
    largest = np.zeros(view.on_lcd.shape)
    for order in [(1, 0), (0, 1)] + ([(2, 0), (3, 0)] if striped else []):
        for side, light in [(np.zeros(2), 2 * target.mean), *sides]:
            waves = side + order
            shown = light * np.prod(np.sinc(fill * waves), axis=-1)
            if striped:
                shown = shown * (1 + 2 * np.cos(2 * np.pi * waves[..., 0] / 3)) / 3
            u, v = np.moveaxis(np.einsum("...k,...kc->...c", waves, view.lcd_per_camera), -1, 0)
            lens = np.exp(-2 * (np.pi * blur) ** 2 * (u * u + v * v)) * np.sinc(u) * np.sinc(v)
            u, v = u - np.rint(u), v - np.rint(v)
            for along, across in ((u, v), (v, u)):
                near = np.maximum(transfer(period, along - 1 / period), transfer(period, along + 1 / period))
                largest = np.maximum(largest, np.abs(shown * lens) * near * transfer(period, across))
    return np.where(view.on_lcd, period / (2 * np.pi) * largest / target.carrier, np.nan)


def noise_floor(view: SampledView) -> dict[str, Any]:
    """One frame's noise over the view, that of the mean of so many frames, and what no mean takes away.

    The controller's own filter passes a frame's noise whole at gain 1, at gain g it leaves sqrt(g / (2 - g)).
    """
    on_lcd, rig = view.on_lcd, view.rig
    depth = depth_sigma_nm(view)[on_lcd]
    known = depth[np.isfinite(depth)]
    rms = float(np.sqrt(np.mean(known**2))) if known.size else np.nan
    gain = rig.control.gain
    return {
        "peak_grey_share": rig.simulation.peak_grey_share,
        "displacement_px": float(np.median(displacement_sigma_px(view)[on_lcd])),
        "slope_urad": median_over(slope_sigma_urad(view), on_lcd),
        "depth_rms_nm": rms,
        "depth_median_nm": float(np.median(known)) if known.size else np.nan,
        "filter_share": float(np.sqrt(gain / (2 - gain))),
        "averaged": [
            {"frames": n, "seconds": n / rig.camera.rate_hz, "depth_rms_nm": rms / np.sqrt(n)} for n in FRAMES
        ],
        "grid_bias_px": float(np.nanmax(grid_bias_px(view))),
    }
