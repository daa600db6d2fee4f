"""Measuring latency, scan-out and rise of the panel: alternating black and white, every frame used."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zeromethod.arrays import Bytes, Float, Image
from zeromethod.calibration.panel_timing import PanelSteps, StepTiming, fit_steps
from zeromethod.commissioning.patterns import TimedPatterns, uniform_pattern
from zeromethod.devices.opening import Devices
from zeromethod.errors import MeasurementError
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

DEFAULT_SECONDS = 3.0

BANDS = 16
"""Bands of panel rows: where camera and panel run at like rates, it is they that lie all over a change."""

FEWEST_NODES = 8
"""Nodes that a band needs."""

FEWEST_CHANGES = 16
MARGIN_S = 0.02
MARGIN_FRAMES = 2.0
BRIGHT_CODES = (255, 190, 128)
"""Brightest picture first; the next where the camera is blinded."""

_BLINDED_SHARE = 0.01


class _Bands:
    """Mean grey of the nodes that see each band of the panel's rows."""

    def __init__(self, rig: Rig, rest: Rest) -> None:
        rows, cols = np.nonzero(rest.visible)
        self._v, self._u = rest.grid.v_px[rows].astype(np.intp), rest.grid.u_px[cols].astype(np.intp)
        place = rest.q[rows, cols, 1] / (rig.display.rows - 1)
        self._band = np.clip((place * BANDS).astype(np.intp), 0, BANDS - 1)
        self._count = np.bincount(self._band, minlength=BANDS)
        whole = self._count >= FEWEST_NODES
        sums = np.bincount(self._band, place, minlength=BANDS)
        self.place = np.where(whole, sums / np.maximum(self._count, 1), np.nan)
        if np.count_nonzero(whole) < 2:
            raise MeasurementError("panel timing: the camera sees too few of the panel's rows")

    def nodes(self, image: Image) -> Float:
        """(n,) grey of the nodes."""
        return image[self._v, self._u].astype(np.float64)

    def means(self, image: Image) -> Float:
        """(bands,) mean grey, NaN for bands that too few nodes see."""
        sums = np.bincount(self._band, self.nodes(image), minlength=BANDS)
        return np.where(np.isfinite(self.place), sums / np.maximum(self._count, 1), np.nan)


def measure_panel_timing(
    rig: Rig,
    devices: Devices,
    seconds: float = DEFAULT_SECONDS,
    on_change: Callable[[], object] = lambda: None,
) -> StepTiming:
    """Show black and white alternately for about `seconds` of the run's clock, 16 changes at least.

    Which rows a pixel sees is taken from the rig, to some percent of the panel. `on_change` is called after
    every change. To be used in the main thread, as windows must be. CameraLost and DisplayLost pass.

    Raises MeasurementError where the camera does not see the panel change, or too few frames fall on changes.
    """
    rest = Rest.of(rig, Optics(rig))
    bands = _Bands(rig, rest)
    pictures = TimedPatterns(rig, devices, MARGIN_S)
    timing = PanelTiming.of(rig.display)
    black, bright = uniform_pattern(rig, 0), _bright(rig, pictures, bands)
    pictures.frames(black, 1)
    hold_s = pictures.hold_s + MARGIN_FRAMES / rig.camera.rate_hz
    start_ns = devices.clock.now_ns()
    since, exposure, rising, grey = [], [], [], []
    count = 0
    while count < FEWEST_CHANGES or devices.clock.now_ns() - start_ns < 1e9 * seconds:
        up = count % 2 == 0
        for since_s, frame in pictures.following(bright if up else black, hold_s):
            since.append(since_s)
            exposure.append(1e-9 * frame.exposure_ns)
            rising.append(up)
            grey.append(bands.means(frame.image))
        count += 1
        on_change()
    steps = PanelSteps(
        np.array(since), np.array(exposure), np.array(rising, dtype=bool), np.array(grey), bands.place
    )
    return fit_steps(steps, timing)


def _bright(rig: Rig, pictures: TimedPatterns, bands: _Bands) -> Bytes:
    """Even picture that does not blind the camera."""
    ceiling = 2**rig.camera.bits - 1
    for code in BRIGHT_CODES:
        picture = uniform_pattern(rig, code)
        grey = bands.nodes(pictures.frames(picture, 1)[0].image)
        if np.mean(grey >= ceiling) < _BLINDED_SHARE:
            return picture
    raise MeasurementError("panel timing: the camera is blinded by the white LCD: a shorter exposure")
