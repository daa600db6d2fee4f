"""The loop: camera in, circle round, display out, and what to do when one of them fails."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.clock import Clock
from zeromethod.control.circle import Circle, Sensor, Taken, controller_of
from zeromethod.control.events import Event
from zeromethod.control.expected_light import ExpectedLight
from zeromethod.control.frame_check import FrameCheck, Verdict
from zeromethod.control.pairing import PanelTiming
from zeromethod.control.presenter import Presenter
from zeromethod.control.rehearsal import rehearse
from zeromethod.control.reopening import Reopener
from zeromethod.control.rest import Rest
from zeromethod.control.state import LOCK_FRAMES, NULLED, Outcome, Status, Turn, next_status
from zeromethod.control.step import Step
from zeromethod.devices.protocols import (
    Camera,
    CameraLost,
    CameraTimeout,
    Display,
    DisplayLost,
    Frame,
)
from zeromethod.optics import Optics
from zeromethod.pattern import Target
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.warp.grid import NodeGrid

TIMEOUTS_TO_STALL = 3
"""Read timeouts running after which the camera counts as stalled."""

WRONG_FRAMES_TO_END = 10
"""Frames of wrong shape or type running after which the run ends."""


@dataclass(frozen=True)
class _Trouble:
    """A turn without a usable frame."""

    outcome: Outcome
    reason: str
    events: tuple[Event, ...]


def _check_members(frame: Frame) -> None:
    """Refuse what is no frame at all. Frames of a class of one's own will do."""
    missing = [field.name for field in fields(Frame) if not hasattr(frame, field.name)]
    if missing:
        raise TypeError(f"read() gave {type(frame).__name__}, which lacks {', '.join(missing)}")


class Loop:
    """Nulls what the camera sees, one frame per `step`; see `zeromethod.control.state` for its states.

    The devices belong to the caller, who closes them. The loop is over (`over`) when it was stopped, or
    when a device is lost for good; the reason is in `status`.
    """

    def __init__(
        self,
        rig: Rig,
        camera: Camera,
        display: Display,
        clock: Clock,
        *,
        reopen_camera: Callable[[], Camera] | None = None,
        optics: Optics | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        """Prepare everything; nothing is shown before the first step.

        optics: the rig's rays, when the caller has them already. sensor: another one than the rig's. Raises
        InputError for a rig that sees no display, or where nothing can draw.
        """
        optics = optics or Optics(rig)
        self.rest = Rest.of(rig, optics)
        self.status = Status()
        self.over = False
        self._camera = camera
        self._clock = clock
        self._timeout_s = rig.control.timeout_s
        target = Target.from_spec(rig.target)
        sensor = sensor or ResidualSensor.from_rig(rig, self.rest.grid, target.light)
        light = ExpectedLight(optics, self.rest)

        def circle() -> Circle:
            return Circle(
                self.rest,
                sensor,
                controller_of(rig.control, self.rest),
                PanelTiming.of(rig.display),
                rig.camera.noise.black_grey,
                rig.target.kind,
                light if light.needed else None,
            )

        rehearse(circle(), target, rig.camera)
        self._circle = circle()
        self._presenter = Presenter(rig, display, self.rest)
        self._check = FrameCheck(rig.camera)
        self._reopener = Reopener(reopen_camera, clock)
        self._camera_gone = False
        self._timeouts = 0
        self._wrong_frames = 0
        self._steps = 0
        self._hold = False
        self._referenced = False
        self._stop = False

    @property
    def grid(self) -> NodeGrid:
        """The nodes."""
        return self.rest.grid

    @property
    def q_rest(self) -> NDArray[np.float64]:
        """(rows, cols, 2) warp of the untouched mirror, LCD px."""
        return self.rest.q

    @property
    def gl_renderer(self) -> str:
        """Name of what draws the pattern, as GL gives it."""
        return self._presenter.gl_renderer

    def hold(self, on: bool = True) -> None:
        """Keep the command as it is while `on`; frames are measured all the same."""
        self._hold = on

    def stop(self) -> None:
        """End the run after the present step."""
        self._stop = True

    def run(self, frames: int | None = None, seconds: float | None = None) -> Iterator[Step]:
        """Step until `frames` frames or `seconds` (of the run's clock) have passed, or the loop is over.

        Ends STOPPED, or in FAULT when a device was lost for good. KeyboardInterrupt passes through.
        """
        start_ns = self._clock.now_ns()
        taken = 0
        try:
            while not (self.over or self._stop):
                if frames is not None and taken >= frames:
                    break
                if seconds is not None and self._clock.now_ns() - start_ns >= 1e9 * seconds:
                    break
                step = self.step()
                taken += step.frame_number is not None
                yield step
        finally:
            if not self.over:
                self._end(Turn(Outcome.STOP, "the run has ended"))

    def _end(self, turn: Turn) -> None:
        self.status = next_status(self.status, turn)
        self.over = True

    def step(self) -> Step:
        """One turn: wait for a frame, measure it, show what it asks for."""
        self._steps += 1
        try:
            if self._steps == 1:
                self._present()
            if self._camera_gone:
                return self._without_frame(self._reopen())
            frame = self._camera.read(self._timeout_s)
            _check_members(frame)
        except CameraTimeout:
            return self._without_frame(self._timed_out())
        except CameraLost as error:
            return self._without_frame(self._lost(f"the camera is lost: {error}", Event.CAMERA_LOST))
        except DisplayLost as error:
            return self._without_frame(self._display_lost(error))
        except Exception as error:
            return self._without_frame(self._broken(error))
        self._timeouts = 0
        return self._with_frame(frame)

    def _with_frame(self, frame: Frame) -> Step:
        started = time.perf_counter()
        verdict = self._check.look_at(frame, self._clock.now_ns())
        taken = Taken(held=verdict.fault) if verdict.fault else self._circle.take(frame, self._hold)
        loop_ms = 1e3 * (time.perf_counter() - started)
        events = verdict.events + taken.events
        turn = self._turn(verdict, taken)
        draw_ms = delay_ms = float("nan")
        if taken.changed:
            started = time.perf_counter()
            try:
                lit_ns = self._present() + self._circle.timing.half_lit_ns
                draw_ms = 1e3 * (time.perf_counter() - started)
                delay_ms = 1e-6 * (lit_ns - frame.time_ns)
            except Exception as error:
                lost = isinstance(error, DisplayLost)
                trouble = self._display_lost(error) if lost else self._broken(error)
                events += trouble.events
                turn = Turn(trouble.outcome, trouble.reason)
        self.status = next_status(self.status, turn)
        if not self._referenced and self.status.state in NULLED:
            self._circle.take_reference(taken)
            self._referenced = True
        return self._step(
            self._clock.now_ns() if verdict.wrong else frame.time_ns,
            events,
            frame_number=frame.number,
            dropped=frame.dropped,
            image=frame.image,
            residual=taken.seen.residual.copy() if taken.seen else None,
            shown_q=taken.seen.shown.q.copy() if taken.seen else None,
            measured=None if Event.PICTURES_MIXED in taken.events else taken.measured,
            residual_rms_px=taken.residual_rms_px,
            valid_share=taken.valid_share,
            loop_ms=loop_ms,
            draw_ms=draw_ms,
            delay_ms=delay_ms,
        )

    def _turn(self, verdict: Verdict, taken: Taken) -> Turn:
        """Tell what a frame means for the state."""
        self._wrong_frames = self._wrong_frames + 1 if verdict.wrong else 0
        if verdict.wrong:
            self.over = self._wrong_frames >= WRONG_FRAMES_TO_END
            return Turn(Outcome.FAILED, verdict.fault)
        if Event.LIGHT_OFF in taken.events:
            return Turn(Outcome.MEASURED, taken.held)
        if taken.held or taken.measured is None:
            return Turn(Outcome.HELD, taken.held)
        # Whether it rests only matters, and is only worked out, where the loop is about to be locked.
        locked = self.status.nulled_frames + 1 >= LOCK_FRAMES
        at_rest = locked and self._circle.at_rest(taken.measured)
        return Turn(Outcome.MEASURED, "", taken.residual_rms_px, taken.valid_share, at_rest)

    def _present(self) -> int:
        q = self._circle.controller.commanded
        time_ns = self._presenter.present(q)
        self._circle.presented(time_ns, q)
        return time_ns

    def _timed_out(self) -> _Trouble:
        self._timeouts += 1
        waited = f"no frame for {self._timeouts * self._timeout_s:g} s"
        if self._timeouts < TIMEOUTS_TO_STALL:
            return _Trouble(Outcome.HELD, waited, (Event.CAMERA_TIMEOUT,))
        return self._lost(f"the camera is stalled: {waited}", Event.CAMERA_STALLED)

    def _lost(self, reason: str, event: Event) -> _Trouble:
        self._camera_gone = True
        self.over = self._reopener.exhausted
        return _Trouble(Outcome.FAILED, reason, (event,))

    def _reopen(self) -> _Trouble:
        camera = self._reopener.attempt()
        if camera is not None:
            self._camera = camera
            self._camera_gone = False
            self._timeouts = 0
            self._check.restart()
            return _Trouble(Outcome.HELD, "the camera was opened again", (Event.CAMERA_REOPENED,))
        self.over = self._reopener.exhausted
        return _Trouble(Outcome.FAILED, "the camera is lost and could not be opened again", ())

    def _broken(self, error: Exception) -> _Trouble:
        """End on what no device may raise: what was measured so far is kept, and the driver is named."""
        self.over = True
        where = traceback.extract_tb(error.__traceback__)[-1]
        told = " ".join(str(error).split()) or "no message"
        reason = f"{type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {told}"
        return _Trouble(Outcome.FAILED, reason, (Event.DEVICE_BROKEN,))

    def _display_lost(self, error: Exception) -> _Trouble:
        self.over = True
        return _Trouble(Outcome.FAILED, f"the display is lost: {error}", (Event.DISPLAY_LOST,))

    def _without_frame(self, trouble: _Trouble) -> Step:
        self.status = next_status(self.status, Turn(trouble.outcome, trouble.reason))
        return self._step(self._clock.now_ns(), trouble.events)

    def _step(self, time_ns: int, events: tuple[Event, ...], **figures: Any) -> Step:
        filtered = self._circle.controller.filtered(time_ns)
        return Step(
            number=self._steps,
            time_ns=time_ns,
            state=self.status.state,
            reason=self.status.reason,
            events=events,
            commanded_q=self._circle.controller.commanded,
            filtered=filtered,
            **figures,
        )
