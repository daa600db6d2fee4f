"""The carrier's best period by what a calibration measured: blur, light and noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.commissioning.calibration.rest import RestFrames
from zeromethod.commissioning.calibration.settling import Settling
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.design.carrier import carrier_figures, carrier_words
from zeromethod.design.sampled_view import SampledView
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig

SURE = 4.0
"""Sigmas by which a blur must show in the fringes to count instead of the rig file's."""

_APART_PX = 5
"""Every so many pixels are looked at along each axis."""


def measured_blur(rig: Rig, found: RestMeasurement, frames: RestFrames) -> tuple[float, float]:
    """Variance of the light's spread in the camera's image, px^2, and its standard deviation, by the fringes.

    Fringes of period P lose contrast as exp(-2 pi^2 v f^2), f their frequency in the camera's image: the
    logarithm of their modulation falls by 2 pi^2 v with f^2. v contains lens, both kinds of pixels and
    whatever the panel itself spreads. Stray light takes the same share from all periods, and drops out.
    NaN and infinity where no fringes are seen, or shifts are uneven.
    """
    sequence, black = frames.sequence, rig.camera.noise.black_grey
    q = found.rest_map.lcd_px
    each = (slice(1, -1, _APART_PX),) * 2
    along_u, along_v = 0.5 * (q[1:-1, 2:] - q[1:-1, :-2]), 0.5 * (q[2:, 1:-1] - q[:-2, 1:-1])
    slopes = np.stack([along_u, along_v], axis=-1)[::_APART_PX, ::_APART_PX]  # dq/du, [..., of what, by what]
    if not sequence.even:
        return float("nan"), float("inf")
    turns = np.exp(1j * np.array(sequence.shifts_rad))
    count = len(turns)
    logs, squares = [], []
    for number, one in enumerate(sequence.sets()):
        grey = frames.sums[(slice(number * count, (number + 1) * count), *each)] / frames.frames
        axis = int(one.axis == "rows")
        light = grey.mean(axis=0) - black
        frequency2 = np.sum(slopes[..., axis, :] ** 2, axis=-1) / sequence.periods[axis][one.period] ** 2
        modulation = 2 / count * np.abs(np.tensordot(turns, grey, axes=1))
        good = np.isfinite(frequency2) & (light > 1.0) & (modulation > 1.0)
        if not good.any():
            return float("nan"), float("inf")
        logs.append(float(np.median(np.log(modulation[good] / light[good]))))
        squares.append(float(np.median(frequency2[good])))
    return _slope(np.array(logs), -2 * np.pi**2 * np.array(squares))


def _slope(values: Float, at: Float) -> tuple[float, float]:
    """Slope of a straight line and its standard deviation by the points' own scatter; see `measured_blur`."""
    apart = at - at.mean()
    slope = float(apart @ values / (apart @ apart))
    left = values - values.mean() - slope * apart
    return slope, float(np.sqrt(left @ left / (len(values) - 2) / (apart @ apart)))


def advised_carrier(
    rig: Rig, found: RestMeasurement, frames: RestFrames, settling: Settling
) -> dict[str, Any] | None:
    """`carrier_figures` of a bench by what was measured of it; None where its nodes see too little.

    rig: the calibrated one, with its measured noise. White is the camera's grey level by the white LCD, blur
    that of the fringes where it shows by `SURE` sigmas; "blur_measured" says whether, "words" what another
    period would bring (`carrier_words`).
    """
    white = min(settling.white_grey / (2**rig.camera.bits - 1), 1.0)
    simulation = rig.simulation.model_copy(update={"peak_grey_share": white})
    rig = rig.model_copy(update={"simulation": simulation})
    try:
        view = SampledView(rig)
        spread_px2, sigma_px2 = measured_blur(rig, found, frames)
        measured = spread_px2 > SURE * sigma_px2
        if measured:
            lens_px2 = spread_px2 - 1 / 12 - _apertures_px2(view)
            camera = rig.camera.model_copy(update={"psf_px": float(np.sqrt(max(lens_px2, 0.0)))})
            view = SampledView(rig.model_copy(update={"camera": camera}))
        figures = carrier_figures(view)
    except InputError:
        return None
    return figures | {"blur_measured": bool(measured), "words": carrier_words(figures)}


def _apertures_px2(view: SampledView) -> float:
    """Variance of the LCD's lit apertures in the camera's image, px^2, the mean of both axes of the LCD."""
    slopes2 = np.sum(view.lcd_per_camera[view.on_lcd] ** 2, axis=-1)
    fill2 = np.array(view.rig.display.fill_factor) ** 2
    return float(np.mean(fill2 / 12 / np.median(slopes2, axis=0)))
