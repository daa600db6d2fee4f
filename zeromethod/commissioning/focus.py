"""Setting up by eye: what one frame of the target at rest says of focus, exposure and view.

Nothing here closes the loop. The picture is the rig's target drawn through its rest map, so that a bench
that is as its rig file says shows crossed cosines of exactly the target's period.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Mask
from zeromethod.commissioning.orientation import Alignment
from zeromethod.optics import Optics
from zeromethod.pattern import Target
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

HISTOGRAM_BINS = 32
REGIONS = 3
"""The view is judged in 3 x 3 regions."""

LIT_SHARE = 0.1
"""Nodes with less than this share of the brightest nodes' light count as dark."""

BRIGHT_PERCENTILE = 99.0
FITTED_SHARE = 0.3
"""Share of the nodes that must be measured before the picture's size and turn are given."""


@dataclass(frozen=True)
class FocusReport:
    """What one frame says. Shares are 0..1; NaN where nothing is seen.

    score: modulation transfer of lens, focus and LCD, by the picture's contrast, wherever it lies and
    whatever its size, the median of the lit nodes; stray light lowers it too, unless it is known. on_target:
    the same at the target's own period alone, which a picture of another size lacks. blur_px: Gaussian sigma
    that would do the same, camera px.
    modulation: (3, 3) median transfer per region, image rows first. histogram: (32,) shares of the pixels
    from black to full scale. mean_grey, bright_grey: of the frame, and its 99th percentile. saturated_share:
    pixels at full scale. dark_share: nodes that should see the LCD and get hardly any light. usable_share: of
    these nodes, lit, unsaturated and well modulated. seen_share: share of the view's nodes that should see
    the LCD at all.
    alignment: by an affine fit to the residual, so that its shifts are known up to whole periods; None where
    too little is measured, or the picture lies too far from where it should.
    """

    score: float
    on_target: float
    blur_px: float
    modulation: Float
    histogram: Float
    mean_grey: float
    bright_grey: float
    full_grey: float
    saturated_share: float
    dark_share: float
    usable_share: float
    seen_share: float
    alignment: Alignment | None


class FocusMeter:
    """Turns frames of a rig's camera into reports; crossed cosines whatever the rig's target.

    Raises InputError for a rig that sees no display.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig.model_copy(update={"target": rig.target.model_copy(update={"kind": "cosines"})})
        self.rest = Rest.of(self.rig, Optics(self.rig))
        target = Target.from_spec(self.rig.target)
        self._sensor = ResidualSensor.from_rig(self.rig, self.rest.grid, target.light)

    def look(self, image: Image, stray_grey: float = 0.0) -> FocusReport:
        """Report of one image (rows, cols), uint8 or uint16; InputError for another shape or type.

        stray_grey: grey levels of light that is known not to come from the LCD.
        """
        return focus_report(image, self._sensor.measure(image), self.rest, self.rig, stray_grey)


def focus_report(
    image: Image, residual: Residual, rest: Rest, rig: Rig, stray_grey: float = 0.0
) -> FocusReport:
    """Report of an image and of what the sensor made of it; the rig's target is cosines."""
    black, full = rig.camera.noise.black_grey, float(2**rig.camera.bits - 1)
    seen = rest.visible
    light = residual.mean.astype(float) - black - stray_grey
    brightest = float(np.percentile(light[seen], BRIGHT_PERCENTILE)) if seen.any() else 0.0
    lit = seen & (light > max(LIT_SHARE * brightest, 1.0))
    drawn = 0.5 * rig.target.contrast  # each of the two carriers' amplitude over the mean light
    with np.errstate(divide="ignore", invalid="ignore"):
        on_target = np.where(lit, residual.modulation.mean(axis=-1) / (drawn * light), np.nan)
        transfer = np.where(lit, _contrast_grey(image, rig, rest) / (drawn * light), np.nan)
    score = _median(transfer)
    counts, _ = np.histogram(image, HISTOGRAM_BINS, (0.0, full + 1))
    saturated = Flag.SATURATED | Flag.MODULATION
    usable = lit & (residual.flags & saturated == 0)
    expected = max(int(np.count_nonzero(seen)), 1)
    return FocusReport(
        score=score,
        on_target=_median(on_target),
        blur_px=_blur_px(score, rig.target.period_px),
        modulation=_by_region(transfer, rest),
        histogram=counts / image.size,
        mean_grey=float(image.mean()),
        bright_grey=float(np.percentile(image[::3, ::3], BRIGHT_PERCENTILE)),
        full_grey=full,
        saturated_share=float(np.mean(image >= full)),
        dark_share=1 - np.count_nonzero(lit) / expected,
        usable_share=np.count_nonzero(usable) / expected,
        seen_share=float(np.mean(seen[rest.grid.inner])),
        alignment=_alignment(residual, usable & residual.valid, rest),
    )


def _contrast_grey(image: Image, rig: Rig, rest: Rest) -> Float:
    """Amplitude (rows, cols) of each of two crossed cosines at the nodes, grey levels, whatever their period.

    By the variance about the local mean, less the camera's noise, in windows that span two periods.
    """
    noise, size = rig.camera.noise, (rig.target.period_px,) * 2
    grey = image.astype(np.float32) - np.float32(noise.black_grey)
    mean, square = (cv2.blur(cv2.blur(one, size), size) for one in (grey, grey * grey))
    v, u = (
        np.clip(np.rint(axis).astype(np.intp), 0, limit - 1)
        for axis, limit in ((rest.grid.v_px, image.shape[0]), (rest.grid.u_px, image.shape[1]))
    )
    at = np.ix_(v, u)
    variance = square[at].astype(np.float64) - mean[at].astype(np.float64) ** 2 - noise.read_grey**2
    if noise.electrons_per_grey is not None:
        variance -= np.maximum(mean[at], 0.0) / noise.electrons_per_grey
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _median(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _blur_px(score: float, period_px: int) -> float:
    """Gaussian sigma whose transfer at the period is `score`: exp(-2 (pi sigma / P)^2)."""
    if not score > 0:
        return math.nan
    return period_px / math.pi * math.sqrt(max(-0.5 * math.log(score), 0.0))


def _by_region(transfer: Float, rest: Rest) -> Float:
    inner = transfer[rest.grid.inner]
    out = np.full((REGIONS, REGIONS), np.nan)
    for row, band in enumerate(np.array_split(inner, REGIONS, axis=0)):
        for column, part in enumerate(np.array_split(band, REGIONS, axis=1)):
            out[row, column] = _median(part)
    return out


def _alignment(residual: Residual, known: Mask, rest: Rest) -> Alignment | None:
    """Place, size and turn by least squares: seen(x) = target(x + d), so d = M x turns and shrinks it."""
    if np.count_nonzero(known) < FITTED_SHARE * np.count_nonzero(rest.visible) or not known.any():
        return None
    u, v = (axis - axis[rest.visible].mean() for axis in rest.grid.mesh())
    terms = np.stack([np.ones_like(u), u, v], axis=-1)[known]
    (middle, (uu, vu), (uv, vv)), *_ = np.linalg.lstsq(terms, residual.d[known], rcond=None)
    wider, higher = (float(1 / (1 + slope) - 1) for slope in (uu, vv))
    return Alignment(wider, higher, math.degrees(0.5 * (uv - vu)), *(-float(d) for d in middle))
