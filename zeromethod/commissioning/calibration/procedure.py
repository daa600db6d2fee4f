"""The steps of a calibration, in order, on an open bench: what is shown, captured and kept."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zeromethod.calibration import Direct, Fit, Intrinsics, MirrorEdge, Observation, RestPositions, fit
from zeromethod.calibration.fingerprint import Fingerprint, take_fingerprint
from zeromethod.calibration.panel_timing import StepTiming
from zeromethod.clock import HostClock
from zeromethod.commissioning.calibration.lens import with_intrinsics
from zeromethod.commissioning.calibration.presses import (
    DEFAULT_FRAMES,
    DEFAULT_PATIENCE_S,
    PressesEndedError,
    PressWarps,
    record_presses,
)
from zeromethod.commissioning.calibration.prompts import Silence, Teller
from zeromethod.commissioning.calibration.rest import RestFrames, capture, decode, rest_notes, sequence_for
from zeromethod.commissioning.calibration.settling import Settling, settle
from zeromethod.commissioning.decode import refuse_empty
from zeromethod.commissioning.delay import DelayResult, measure_delay, with_strips
from zeromethod.commissioning.panel_timing import FEWEST_CHANGES, measure_panel_timing
from zeromethod.commissioning.response import MARGIN_S, PICTURES, LightResult, measure_light
from zeromethod.commissioning.standing_patterns import HeldPictures
from zeromethod.decoding.measuring import RestMeasurement
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.errors import InputError, MeasurementError
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid

REST_FRAMES = 4
"""Camera frames averaged for every picture of the rest map."""

DELAY_S = 3.0

USABLE_REFRESHES = 0.1
"""Standard deviation, in refreshes, of a delay by changes of the picture that serves where codes do not."""

_TIMING = frozenset({"display.latency_s", "display.scanout_s", "display.scan", "display.rise_s"})

Known = Direct | MirrorEdge | Intrinsics
"""What a person measures or sees beside the procedure."""


@dataclass(frozen=True)
class Plan:
    """What to measure.

    press_depths_mm: of the presses that will come, in order; press_sigma_mm: how well each is known. ball_mm:
    radius of a ball that is pressed in after them, and its sigma. known: what was measured by hand, seen of
    the mirror's edges, or found of the camera by itself. edges: whether those that are not known are looked
    for in the pictures. light, delay: whether these steps are taken.
    rest_frames, press_frames: camera frames averaged for each picture and press. delay_s: how long the delay
    is measured. patience_s: longest wait for a press.
    """

    press_depths_mm: tuple[float, ...] = ()
    press_sigma_mm: float = 1e-3
    known: tuple[Known, ...] = ()
    light: bool = True
    delay: bool = True
    rest_frames: int = REST_FRAMES
    press_frames: int = DEFAULT_FRAMES
    delay_s: float = DELAY_S
    patience_s: float = DEFAULT_PATIENCE_S
    ball_mm: tuple[float, float] | None = None
    edges: bool = True

    def __post_init__(self) -> None:
        """Refuse numbers that cannot be, with InputError."""
        for depth in self.press_depths_mm:
            if not (np.isfinite(depth) and depth > 0):
                raise InputError(f"--press-depths: {depth}: numbers of mm above 0")
        if not (np.isfinite(self.press_sigma_mm) and self.press_sigma_mm > 0):
            raise InputError(f"--depth-sigma: {self.press_sigma_mm}: a number of mm above 0")
        if self.ball_mm is not None and not all(np.isfinite(one) and one > 0 for one in self.ball_mm):
            radius, sigma = self.ball_mm
            raise InputError(f"--ball: {radius:g}:{sigma:g}: radius and sigma in mm, above 0")

    @property
    def presses(self) -> int:
        """How many presses are asked for, the ball among them."""
        return len(self.press_depths_mm) + (self.ball_mm is not None)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Everything that a bench gave, enough to begin anew without it.

    rig: as the rig file says, with the devices used. values: of the rig file that were measured directly
    (response, noise, timing), by dotted key. light, delay, panel, presses: None where they were left out.
    seconds: that each step took, of the machine's time. failure: why not all presses were taken; the plan
    then holds those that were. interrupted: by Ctrl-C.
    """

    rig: Rig
    plan: Plan
    fingerprint: Fingerprint
    settling: Settling
    rest: RestFrames
    light: LightResult | None = None
    delay: DelayResult | None = None
    panel: StepTiming | None = None
    presses: PressWarps | None = None
    values: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    failure: str = ""
    interrupted: bool = False


def with_values(rig: Rig, values: Mapping[str, Any]) -> Rig:
    """Rig with values by dotted key of two or three parts, checked as those of a file are."""
    data = rig.model_dump(exclude_unset=True)
    for key, value in values.items():
        *tables, name = key.split(".")
        table = data
        for step in tables:
            table = table.setdefault(step, {})
        table[name] = tuple(value) if isinstance(value, list) else value
    return Rig.model_validate(data)


def rest_observations(rig: Rig, found: RestMeasurement, known: tuple[Known, ...]) -> list[Observation]:
    """The rest map and what was measured by hand, as a fit takes them."""
    grid = grid_of(rig)
    return [RestPositions.of(grid, found.rest_map.warp(grid)), *known]


def first_fit(rig: Rig, found: RestMeasurement, known: tuple[Known, ...]) -> Fit:
    """Fit without presses: good enough to close the loop, and to know where to look for edges."""
    rig, priors = with_intrinsics(rig, known)
    return fit(priors, rest_observations(rig, found, known))


def grid_of(rig: Rig) -> NodeGrid:
    """The nodes of a rig's warps."""
    return NodeGrid((rig.camera.rows, rig.camera.columns), rig.target.period_px)


def record(
    rig: Rig, devices: Devices, plan: Plan, tell: Teller | None = None
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
    session = _Session(rig.model_copy(update={"camera": camera}), devices, plan, tell or Silence())
    try:
        return session.run()
    except CameraLost as error:
        raise MeasurementError(f"{session.step}: the camera is lost: {error}") from error
    except DisplayLost as error:
        raise MeasurementError(f"{session.step}: the display is lost: {error}") from error


class _Session:
    def __init__(self, rig: Rig, devices: Devices, plan: Plan, tell: Teller) -> None:
        self._given, self._devices, self._plan, self._tell = rig, devices, plan, tell
        self._seconds: dict[str, float] = {}
        self._values: dict[str, Any] = {}
        self._notes: list[str] = []
        self._failure, self._interrupted = "", False
        self._began_s = time.monotonic()
        self.step = "opening"

    def _begin(self, step: str) -> None:
        now_s = time.monotonic()
        self._seconds[self.step] = now_s - self._began_s
        self._began_s, self.step = now_s, step

    def run(self) -> tuple[Recorded, RestMeasurement]:
        plan, devices, tell = self._plan, self._devices, self._tell
        fingerprint = take_fingerprint(self._given, devices.camera, devices.display)
        self._begin("settling")
        tell.say("do not touch the mirror before you are asked to")
        with tell.part("settling", 1) as advance:
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
        rig = with_values(self._given, self._values)

        self._begin("rest map")
        pictures = HeldPictures(rig, devices, 0.0)
        pictures.hold_s = hold_s
        sequence = sequence_for(rig)
        with tell.part("rest map", sequence.frames) as advance:
            frames = capture(rig, pictures, sequence, plan.rest_frames, advance, settling.variance_grey2)
        self._begin("decoding")
        with tell.part("decoding", 1) as advance:
            found = self._decoded(rig, frames)
            advance()
        refuse_empty(found)
        for words in rest_notes(found):
            self._note(words)
        panel, delay, presses = None, None, None
        try:
            if self._interrupted:
                raise KeyboardInterrupt
            self._begin("first fit")
            with tell.part("geometry from the rest map", 1) as advance:
                fitted = first_fit(rig, found, plan.known)
                advance()
            panel = self._panel(fitted.rig)
            delay = self._delay(with_values(fitted.rig, self._timing()), panel)
            presses = self._presses(fitted.rig)
        except KeyboardInterrupt:
            # The rest map is sound. Ctrl-C between presses is theirs to take.
            self._end_early(f"{self.step}: interrupted", 0, interrupted=True)
        self._begin("")
        del self._seconds["opening"]
        recorded = Recorded(
            self._given,
            self._plan,
            fingerprint,
            settling,
            frames,
            light,
            delay,
            panel,
            presses,
            self._values,
            self._seconds,
            tuple(self._notes),
            self._failure,
            self._interrupted,
        )
        return recorded, found

    def _note(self, words: str) -> None:
        self._notes.append(words)
        self._tell.say(f"! {words}")

    def _decoded(self, rig: Rig, frames: RestFrames) -> RestMeasurement:
        """Decode what was captured, also at the first Ctrl-C: without it nothing could be kept."""
        try:
            return decode(rig, frames)
        except KeyboardInterrupt:
            self._interrupted = True
            self._tell.say("! interrupted: finishing the rest map, to keep it (again: keep nothing)")
            return decode(rig, frames)

    def _light(self, hold_s: float) -> LightResult | None:
        if not self._plan.light:
            return None
        self._begin("light")
        # The delay is not known yet: pictures are held for as long as changes were seen to take.
        usual_s = HeldPictures(self._given, self._devices, MARGIN_S).hold_s
        late_s = max(self._given.display.latency_s, 0.0) + max(hold_s - usual_s, 0.0)
        display = self._given.display.model_copy(update={"latency_s": late_s})
        with self._tell.part("light", PICTURES) as advance:
            light = measure_light(self._given.model_copy(update={"display": display}), self._devices, advance)
        for words in light.advice:
            self._note(words)
        self._values |= light.rig_values()
        return light

    def _timing(self) -> dict[str, Any]:
        """What is known of the panel's timing by now."""
        return {key: value for key, value in self._values.items() if key in _TIMING}

    def _panel(self, rig: Rig) -> StepTiming | None:
        """Scan-out and rise; what cannot be told stays as the rig file has it."""
        if not self._plan.delay:
            return None
        self._begin("panel")
        with self._tell.part("scan-out and rise", FEWEST_CHANGES) as advance:
            try:
                panel = measure_panel_timing(rig, self._devices, 0.0, advance)
            except MeasurementError as error:
                self._note(f"{error}; the rig file's scan-out and rise stay")
                return None
        self._values |= panel.rig_values()
        return panel

    def _delay(self, rig: Rig, panel: StepTiming | None) -> DelayResult | None:
        if not self._plan.delay:
            return None
        self._begin("delay")
        with self._tell.part("delay", round(self._plan.delay_s * rig.camera.rate_hz)) as advance:
            try:
                delay = measure_delay(rig, self._devices, self._plan.delay_s, advance)
            except MeasurementError as error:
                if panel is not None and panel.latency_sigma_s < USABLE_REFRESHES / rig.display.refresh_hz:
                    self._values["display.latency_s"] = round(panel.latency_s, 6)
                    self._note(f"{error}; {1e3 * panel.latency_s:.1f} ms by changes of the picture are taken")
                else:
                    self._note(f"{error}; the rig file's {1e3 * rig.display.latency_s:g} ms stay")
                return None
        self._values["display.latency_s"] = round(delay.latency_s, 6)
        return delay

    def _presses(self, rig: Rig) -> PressWarps | None:
        if not self._plan.presses:
            return None
        self._begin("presses")
        timed = with_values(rig, self._timing())
        told = "strips" in rig.control.model_fields_set
        if not told and (isinstance(self._devices.clock, HostClock) or "display.latency_s" in self._values):
            timed = with_strips(timed)
        plan = self._plan
        try:
            return record_presses(
                timed,
                self._devices,
                plan.press_depths_mm,
                plan.press_frames,
                plan.patience_s,
                self._tell,
                ball_radius_mm=plan.ball_mm[0] if plan.ball_mm is not None else None,
            )
        except PressesEndedError as error:
            # What there is already took minutes and is sound.
            count = len(error.warps.pressed) if error.warps is not None else 0
            self._end_early(str(error), count, interrupted=error.interrupted)
            return error.warps if count else None

    def _end_early(self, why: str, presses: int, *, interrupted: bool) -> None:
        """Leave it at what there is, `presses` of known depth among it."""
        self._failure, self._interrupted = why, interrupted
        self._note(f"{why}; going on with what there is")
        # The ball comes last: where something is missing, it is the ball at least.
        depths_mm = self._plan.press_depths_mm[:presses]
        self._plan = replace(self._plan, press_depths_mm=depths_mm, ball_mm=None)
