"""The steps of a calibration, in order, on an open bench: what is shown, captured and kept."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from zeromethod.calibration.fingerprint import take_fingerprint
from zeromethod.calibration.panel_timing import StepTiming
from zeromethod.calibration.shortfall import Lack, Part, Shortfall
from zeromethod.clock import HostClock
from zeromethod.commissioning.calibration.first_fit import first_fit
from zeromethod.commissioning.calibration.plan import Plan, Recorded
from zeromethod.commissioning.calibration.presses import PressesEndedError, PressWarps, record_presses
from zeromethod.commissioning.calibration.projector import PROJECTED, Projection, see_projection
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
from zeromethod.commissioning.calibration.rest import RestFrames, capture, decode, rest_notes, sequence_for
from zeromethod.commissioning.calibration.settling import settle
from zeromethod.commissioning.decode import refuse_empty
from zeromethod.commissioning.delay import DelayResult, measure_delay, with_strips
from zeromethod.commissioning.light_result import LightResult
from zeromethod.commissioning.panel_timing import FEWEST_CHANGES, measure_panel_timing
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.commissioning.response import MARGIN_S, PICTURES, measure_light
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.devices.opening import Devices
from zeromethod.devices.projectors import Projector, open_projectors
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.errors import MeasurementError
from zeromethod.rig.model import Rig

USABLE_REFRESHES = 0.1
"""Standard deviation, in refreshes, of a delay by changes of the picture that serves where codes do not."""

_TIMING = frozenset(
    {"display.latency_s", "display.latency_range_s", "display.scanout_s", "display.scan", "display.rise_s"}
)


def record(
    rig: Rig, devices: Devices, plan: Plan, prompts: Prompts | None = None
) -> tuple[Recorded, RestMeasurement]:
    """Take a bench through all steps: light, rest map, delay, presses. `rig`: what is believed of it.

    To be used in the main thread, as windows must be. Nothing may touch the mirror before a press is asked
    for. Also gives the rest map as decoded on the way.

    Raises
    ------
    MeasurementError
        A step failed, or a device was lost; the message begins with the step. Presses that do not come are
        no failure of the rest, nor is Ctrl-C once there is a rest map: see `Recorded.failure`.
    KeyboardInterrupt
        Ctrl-C before that.
    """
    # a rest measured before has no part in what is measured now
    camera = rig.camera.model_copy(update={"rest_map": None})
    with ExitStack() as stack:
        projectors = open_projectors(rig.projector, devices.display, stack) if rig.projector else []
        session = _Session(
            rig.model_copy(update={"camera": camera}), devices, plan, prompts or Silent(), projectors
        )
        try:
            return session.run()
        except CameraLost as error:
            raise MeasurementError(f"{session.step}: the camera is lost: {error}") from error
        except DisplayLost as error:
            raise MeasurementError(f"{session.step}: the display is lost: {error}") from error
        except MeasurementError as error:
            raise MeasurementError(f"{session.step}: {error}") from error


def _ms(bounds_s: tuple[float, float]) -> str:
    return f"{1e3 * bounds_s[0]:.1f} to {1e3 * bounds_s[1]:.1f} ms"


class _Session:
    def __init__(
        self, rig: Rig, devices: Devices, plan: Plan, prompts: Prompts, projectors: Sequence[Projector]
    ) -> None:
        self._projectors = projectors
        self._given, self._devices, self._plan, self._prompts = rig, devices, plan, prompts
        self._seconds: dict[str, float] = {}
        self._values: dict[str, Any] = {}
        self._notes: list[str] = []
        self._shortfalls: list[Shortfall] = []
        self._failure: str | None = None
        self._interrupted = False
        self._began_s = time.monotonic()
        self.step = "opening"

    def _begin(self, step: str) -> None:
        now_s = time.monotonic()
        self._seconds[self.step] = now_s - self._began_s
        self._began_s, self.step = now_s, step

    def run(self) -> tuple[Recorded, RestMeasurement]:
        plan, devices, prompts = self._plan, self._devices, self._prompts
        fingerprint = take_fingerprint(self._given, devices.camera, devices.display)
        self._begin("settling")
        prompts.say("do not touch the mirror before you are asked to")
        with prompts.part("settling", 1) as advance:
            settling = settle(self._given, devices)
            advance()
        if settling.saturated_share > 0.01:
            self._note(
                f"{settling.saturated_share:.0%} of the view is too bright for the camera by the white LCD: "
                "shorten the exposure"
            )
        hold_s = settling.hold_s
        light = self._light(hold_s)
        if light is not None:
            hold_s = max(hold_s, light.hold_s if light.hold_s < 2 * hold_s else 0.0)
        rig = self._given.replace(self._values)

        self._begin("rest map")
        pictures = TimedPatterns(rig, devices, 0.0)
        pictures.hold_s = hold_s
        sequence = sequence_for(rig)
        with prompts.part("rest map", sequence.frames) as advance:
            frames = capture(rig, pictures, sequence, plan.rest_frames, advance, settling.variance_grey2)
        self._begin("decoding")
        with prompts.part("decoding", 1) as advance:
            found = self._decoded(rig, frames)
            advance()
        refuse_empty(found)
        for words in rest_notes(found, saw=rig.prism.teeth is not None):
            self._note(words)
        projection, panel, delay, presses = None, None, None, None
        try:
            if self._interrupted:
                raise KeyboardInterrupt
            projection = self._projection(pictures)
            self._begin("first fit")
            with prompts.part("geometry from the rest map", 1) as advance:
                fitted = first_fit(rig, found, plan.known)
                advance()
            panel = self._panel(fitted.rig)
            delay = self._delay(fitted.rig.replace(self._timing()), panel)
            presses = self._presses(fitted.rig)
        except KeyboardInterrupt:
            # The rest map is sound. Ctrl-C between presses is handled there.
            self._end_early(f"{self.step}: interrupted", 0, interrupted=True)
            if plan.delay and delay is None:
                self._lacks(Part.DELAY, Lack.SKIPPED, "interrupted; the rig file's timing holds, unmeasured")
        self._begin("")
        del self._seconds["opening"]
        recorded = Recorded(
            *(self._given, self._plan, fingerprint, settling, frames, light, delay, panel, presses),
            *(projection, tuple(self._shortfalls), self._values, self._seconds, tuple(self._notes)),
            *(self._failure, self._interrupted),
        )
        return recorded, found

    def _projection(self, pictures: TimedPatterns) -> Projection | None:
        """What is seen of the projector's fringes; what is not stays as the rig file has it."""
        if not self._projectors:
            return None
        self._begin("projector")
        rig, clock = self._given, self._devices.clock
        with self._prompts.part("projector", PROJECTED) as advance:
            try:
                return see_projection(
                    rig, pictures, self._projectors, self._plan.rest_frames, clock.now_ns, advance
                )
            except MeasurementError as error:
                self._note(str(error))
                return None

    def _note(self, words: str) -> None:
        self._notes.append(words)
        self._prompts.say(f"! {words}")

    def _lacks(self, part: Part, lack: Lack, why: str) -> None:
        self._shortfalls.append(Shortfall(part, lack, why))
        if lack is not Lack.SKIPPED:
            self._note(self._shortfalls[-1].words)

    def _decoded(self, rig: Rig, frames: RestFrames) -> RestMeasurement:
        """Decode what was captured, also at the first Ctrl-C: without it nothing could be kept."""
        try:
            return decode(rig, frames)
        except KeyboardInterrupt:
            self._interrupted = True
            self._prompts.say("! interrupted: finishing the rest map, to keep it (again: keep nothing)")
            return decode(rig, frames)

    def _light(self, hold_s: float) -> LightResult | None:
        if not self._plan.light:
            self._lacks(Part.LIGHT, Lack.SKIPPED, "the rig file's response and noise hold, unmeasured")
            return None
        self._begin("light")
        # The delay is not known yet: pictures are shown for as long as changes took.
        usual_s = TimedPatterns(self._given, self._devices, MARGIN_S).hold_s
        late_s = max(self._given.display.latency_s, 0.0) + max(hold_s - usual_s, 0.0)
        display = self._given.display.model_copy(update={"latency_s": late_s})
        with self._prompts.part("light", PICTURES) as advance:
            light = measure_light(self._given.model_copy(update={"display": display}), self._devices, advance)
        for words in light.advice:
            self._note(words)
        self._values |= light.rig_values()
        return light

    def _timing(self) -> dict[str, Any]:
        """What is known of the panel's timing by now."""
        return {key: value for key, value in self._values.items() if key in _TIMING}

    def _panel(self, rig: Rig) -> StepTiming | None:
        """Scan-out and rise; what cannot be measured stays as the rig file has it."""
        if not self._plan.delay:
            return None  # `_delay` says so
        self._begin("panel")
        with self._prompts.part("scan-out and rise", FEWEST_CHANGES) as advance:
            try:
                panel = measure_panel_timing(rig, self._devices, 0.0, advance)
            except MeasurementError as error:
                self._lacks(Part.PANEL, Lack.FAILED, f"{error}; the rig file's stay")
                return None
        self._values |= panel.rig_values()
        return panel

    def _delay(self, rig: Rig, panel: StepTiming | None) -> DelayResult | None:
        file_ms = f"{1e3 * rig.display.latency_s:g} ms"
        if not self._plan.delay:
            if (bounds := rig.display.latency_range_s) is not None:
                self._lacks(Part.DELAY, Lack.BOUNDED, f"{_ms(bounds)}, by the rig file")
            else:
                self._lacks(Part.DELAY, Lack.SKIPPED, f"the rig file's timing holds ({file_ms}), unmeasured")
            return None
        self._begin("delay")
        with self._prompts.part("delay", round(self._plan.delay_s * rig.camera.rate_hz)) as advance:
            try:
                delay = measure_delay(rig, self._devices, self._plan.delay_s, advance)
                why = delay.why
            except MeasurementError as error:
                delay, why = None, str(error).removeprefix("delay: ")
        if delay is not None and delay.range_s is None:
            self._values |= delay.rig_values(rig.display.latency_s)
        elif panel is not None and panel.latency_sigma_s < USABLE_REFRESHES / rig.display.refresh_hz:
            self._values |= {"display.latency_s": round(panel.latency_s, 6), "display.latency_range_s": None}
            self._note(f"delay: {why}; {1e3 * panel.latency_s:.1f} ms by changes of the picture are taken")
        elif delay is not None and delay.range_s is not None:
            self._values |= delay.rig_values(rig.display.latency_s)
            taken_ms = 1e3 * self._values["display.latency_s"]
            self._lacks(Part.DELAY, Lack.BOUNDED, f"{_ms(delay.range_s)}: {why}; {taken_ms:.1f} ms are taken")
        else:
            self._lacks(Part.DELAY, Lack.FAILED, f"{why}; the rig file's {file_ms} may be wrong")
        return delay

    def _presses(self, rig: Rig) -> PressWarps | None:
        if not self._plan.presses:
            return None
        self._begin("presses")
        timed = rig.replace(self._timing())
        timed_here = isinstance(self._devices.clock, HostClock) or "display.latency_s" in self._values
        if rig.control.strips == "auto" and timed_here:
            timed = with_strips(timed)
        plan = self._plan
        try:
            warps = record_presses(
                timed,
                self._devices,
                plan.press_depths_mm,
                plan.press_frames,
                plan.patience_s,
                self._prompts,
                ball_radius_mm=plan.ball_mm[0] if plan.ball_mm is not None else None,
            )
        except PressesEndedError as error:
            # What there is already took minutes and is sound.
            count = len(error.warps.pressed) if error.warps is not None else 0
            self._end_early(str(error), count, interrupted=error.interrupted)
            return error.warps if count else None
        self._shortfalls = [one.after_presses() for one in self._shortfalls]
        return warps

    def _end_early(self, why: str, presses: int, *, interrupted: bool) -> None:
        """Leave it at what there is, `presses` of known depth among it."""
        self._failure, self._interrupted = why, interrupted
        self._note(f"{why}; going on with what there is")
        if self._plan.presses:
            self._shortfalls.append(Shortfall(Part.PRESSES, Lack.FAILED, why))
        # The ball comes last: where something is missing, it is the ball at least.
        depths_mm = self._plan.press_depths_mm[:presses]
        self._plan = replace(self._plan, press_depths_mm=depths_mm, ball_mm=None)
