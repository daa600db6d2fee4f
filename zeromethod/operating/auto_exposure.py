"""An exposure that follows the light of a run: slowly, and never so long that the picture saturates.

It asks for a new exposure as an operator would, by the run's method, so that it is recorded as such a call.
Every frame states its own exposure, by which the loop holds its light against that at rest.
"""

from __future__ import annotations

import math
from concurrent.futures import Future
from typing import Any, NamedTuple

import numpy as np

from zeromethod.commissioning.light_advice import FLICKER_SHARE, SATURATED_SHARE, advised_exposure_s
from zeromethod.commissioning.setting_up import FlickerMeter
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.operating.controls import Controls
from zeromethod.rig.model import Rig

SOURCE = "auto exposure"
EVERY_S = 0.5
"""Between changes: frames that were under way, and 16 that show how the light flickers."""
MOST_LONGER = 1.25
"""Factor by which one change makes it longer: what comes into view meanwhile may be brighter."""
WITHIN = 1.1
"""Factor from the best exposure within which nothing is changed."""
THINNED = 4
"""Of rows and columns every such one is looked at."""
BRIGHT_PERCENTILE = 99.5
WHOLE = 1e-6
"""Periods from a whole number of them within which an exposure was chosen for it."""


class Greys(NamedTuple):
    """Grey levels of a frame."""

    mean_grey: float
    full_grey: float
    saturated_share: float


class AutoExposure:
    """Sets the exposure of a run by its frames. controls: of the run, with the method `exposure`."""

    def __init__(self, rig: Rig, controls: Controls) -> None:
        self._rig, self._controls = rig, controls
        self._black, self._full = rig.camera.noise.black_grey, 2.0**rig.camera.bits - 1
        self._flicker = FlickerMeter(self._black)
        self._exposure_ns = 0
        self._since_ns = 0
        self._asked: Future[dict[str, Any]] | None = None
        self._changes, self._reason = 0, "the run was too short for another one"

    @property
    def figures(self) -> dict[str, Any]:
        """The exposure of the newest frame, ms, how often another was asked for, and why it is this one."""
        now_ms = 1e-6 * self._exposure_ns
        return {"exposure_ms": now_ms, "changes": self._changes, "reason": self._reason}

    def see(self, step: Step) -> None:
        """Take in the newest step, and change the exposure of later frames where that is due."""
        if step.image is None or not step.exposure_ns or Event.BURST in step.events:
            return
        if step.state is State.APPROACH:  # the first frame after the touch is to be exposed as those before
            return
        if step.exposure_ns != self._exposure_ns:
            self._exposure_ns, self._since_ns = step.exposure_ns, step.time_ns
            self._flicker.forget()
        grey = step.image[::THINNED, ::THINNED]
        bright = float(np.percentile(grey, BRIGHT_PERCENTILE))
        seen = Greys(float(grey.mean()), self._full, float(np.mean(grey >= self._full)))
        share = (bright - self._black) / (self._full - self._black)
        swing = self._flicker.note(seen.mean_grey, 1e-9 * step.time_ns, share)
        blinded = seen.saturated_share > SATURATED_SHARE
        if step.time_ns - self._since_ns < 1e9 * EVERY_S or not (blinded or step.residual is not None):
            return
        hz = self._flicker.mains_hz if swing > FLICKER_SHARE else math.nan
        wanted_s = advised_exposure_s(seen, self._rig, 1e-9 * step.exposure_ns, self._flicker.brightest, hz)
        self._reason = self._why(wanted_s, blinded, hz)
        self._ask(wanted_s)
        self._since_ns = step.time_ns

    def _why(self, wanted_s: float, blinded: bool, hz: float) -> str:
        """Why an exposure is wanted."""
        if math.isnan(wanted_s):
            return "no light"
        if blinded:
            return "the picture saturates"
        if wanted_s >= 1 / self._rig.camera.rate_hz:
            return "more light is wanted than a whole frame brings"
        if math.isfinite(hz) and abs(wanted_s * hz - round(wanted_s * hz)) < WHOLE:
            return f"whole periods of the mains ({hz:.0f} Hz)"
        return "the target's peaks just below saturation"

    def _ask(self, wanted_s: float) -> None:
        """Have later frames exposed so; not again once the camera has refused it."""
        now_s = 1e-9 * self._exposure_ns
        wanted_s = min(wanted_s, MOST_LONGER * now_s, 1 / self._rig.camera.rate_hz)
        if not (wanted_s > WITHIN * now_s or wanted_s < now_s / WITHIN):
            return
        if self._asked is not None and (not self._asked.done() or self._asked.exception() is not None):
            return
        self._changes += 1
        self._asked = self._controls.call("exposure", {"value": 1e3 * wanted_s}, source=SOURCE)
