"""The loop: camera in, circle round, display out, and what to do when one of them fails."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import ExitStack
from functools import partial
from typing import Any

from zeromethod.arrays import Float, Mask
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.contract import RAISED
from zeromethod.devices.protocols import Camera, Display, Frame
from zeromethod.loop.adjustments import Adjustments
from zeromethod.loop.assembly import make_circle
from zeromethod.loop.bench_doubt import BenchDoubt
from zeromethod.loop.burst import Read
from zeromethod.loop.circle import FrameResult
from zeromethod.loop.display_watch import DisplayWatch
from zeromethod.loop.drawing import HANGING_S, Drawer, Drawing
from zeromethod.loop.events import Event, Notice, Notices
from zeromethod.loop.frame_check import FrameCheck
from zeromethod.loop.frame_outcome import burst_words, frame_figures, frame_outcome
from zeromethod.loop.frame_source import FrameSource, Stopped, Trouble, failure
from zeromethod.loop.light_quality import LightQuality
from zeromethod.loop.pattern_dwell import PatternDwell
from zeromethod.loop.paused_gc import PausedGC
from zeromethod.loop.screen import Screen
from zeromethod.loop.state import Doubt, Outcome, State, Status, StepOutcome, next_status, sees_target
from zeromethod.loop.step import Step
from zeromethod.loop.zero import Zero
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import Sensor

WRONG_FRAMES_TO_END = 10
"""Consecutive frames of wrong shape or type after which the run ends."""


class Loop:
    """Nulls what the camera sees, one frame per `step`; see `zeromethod.loop.state` for its states.

    In simulated time everything happens in the caller's thread. In the host's (`HostClock`) the camera is
    read and the display is drawn in threads of their own, newest only, and nothing that a device does keeps a
    step from returning: use it as a context, or `close` it, to end them.

    The devices belong to the caller, who closes them. `run` may be called again after it ended. The loop is
    over (`over`) when it was closed, or when a device is lost for good; the reason is in `status`.

    Parameters
    ----------
    rig : Rig
        The bench.
    camera, display, clock : Camera, Display, Clock
        Opened devices, and the clock that both share.
    reopen_camera : callable, optional
        Opens the camera again after it was lost.
    optics, sensor : Optics, Sensor, optional
        The rig's rays, when the caller has them already; another sensor than the rig's.
    watches_bench : bool
        Whether motion of the bench makes the state MOVED: not where its rest is yet to be measured.

    Raises
    ------
    InputError
        For a rig that sees no display, or where nothing can draw.
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
        watches_bench: bool = True,
    ) -> None:
        self.live = isinstance(clock, HostClock)
        optics = optics or Optics(rig)
        parts = make_circle(rig, optics, sensor)
        self.rest = parts.rest
        self.grid = self.rest.grid
        """The nodes."""
        self.q_rest = self.rest.q
        """(rows, cols, 2) warp of the untouched mirror, LCD px."""
        self.delay = parts.circle.exposures.delay
        """The delay of display and camera by the coded strips; None without strips."""
        self.paused = False
        """Whether corrections are paused; see `pause`."""
        self.status, self.over = Status(), False
        self.doubt: Doubt | None = None
        """Why readings must not be trusted, set from outside; motion of the bench is judged apart."""
        self.coming = ""
        """What is about to touch, in words, set from outside; while it is set, no burst begins."""
        self.on_wait: Callable[[], None] | None = None
        """Called in the loop's thread once per step, and while one waits: for keys, buttons, windows."""
        self.ended: Step | None = None
        """The step that ended the last `run`: its state and reason, and nothing measured."""
        self._clock = clock
        self._circle = parts.circle
        self._zero = Zero(self.rest)
        self.bench = BenchDoubt(rig, optics, self.rest, self._zero, watches_bench)
        timeout_s, timed = rig.control.timeout_s, parts.strips is not None
        dwell = PatternDwell(1e9 / rig.camera.rate_hz, timed) if self.live or timed else None
        pace = timed, max(timeout_s, HANGING_S), self.live, rig.target.step
        drawing = Drawing(lambda: Drawer(rig, display, clock, parts.rest, parts.strips), *pace)
        self.gl_renderer = drawing.gl_renderer
        """Name of what draws the pattern, as GL gives it."""
        self.adjust = Adjustments(rig, self._circle.controller, drawing)
        self._screen = Screen(drawing, self._circle, clock, dwell, repaints=self.live)
        self._watch = DisplayWatch(display, timeout_s if self.live else None)
        meanwhile = self._attend if self.live else None
        self._source = FrameSource(camera, reopen_camera, clock, timeout_s, meanwhile, rig.camera.reopen_s)
        self._check = FrameCheck(rig.camera)
        self._quality = LightQuality(self.rest.visible, rig.camera.noise.black_grey)
        self._notices = Notices()
        self._garbage: PausedGC | None = None
        self._start_ns: int | None = None
        self._steps, self._passive = 0, rig.control.passive
        self._frozen = self._stop = self._waiting = self._referenced = False

    @property
    def horizon_s(self) -> float:
        """Delay from the mid-exposure of a frame to that of those that see its picture; NaN: unknown."""
        return self._circle.horizon_s

    @property
    def burst_read(self) -> Read | None:
        """What the last burst read, until the mirror moves; None for nothing."""
        return None if self._circle.burst is None else self._circle.burst.read

    def freeze(self, on: bool = True) -> None:
        """Keep the command as it is while `on`; frames are measured all the same."""
        self._frozen = on

    def pause(self, on: bool = True) -> None:
        """Keep the command by the operator's wish: the state is PAUSED until `pause(False)`."""
        self.paused = on

    def light(self, lamp: Mask | None) -> None:
        """Draw white at some nodes, for `screen.LAMP_S` at most; from any thread.

        Parameters
        ----------
        lamp : (rows, cols) bool, optional
            Nodes inside contacts; must not be changed any more. None: nowhere.
        """
        self._screen.light(lamp, self._clock.now_ns())

    def rezero(self) -> None:
        """Take the mean warp of the next nulled frames as that of the untouched mirror, for all readings.

        It ends in a step with ZERO_TAKEN, or ZERO_REFUSED and why in its notes; what is shown stays.
        """
        self._zero.request()

    @property
    def zero(self) -> Float | None:
        """(rows, cols, 2) LCD px, the warp that readings start from less the rig's at rest; None for 0."""
        return self._zero.q

    def stop(self) -> None:
        """End `run` after the present step, and that one at once if it waits."""
        self._stop = True

    def close(self) -> None:
        """End the loop's threads, within half a second; may be called again. The devices stay open."""
        self.over = True
        self._source.close()
        self._screen.close()

    def __enter__(self) -> Loop:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Loop {self.status.state}: {self.status.reason}, {self._steps} steps>"

    def run(self, frames: int | None = None, seconds: float | None = None) -> Generator[Step]:
        """Step until `frames` frames or `seconds` (of the run's clock) have passed, or the loop is over.

        Ends STOPPED, or in FAULT when a device was lost for good; `ended` is the step that says so. A loop
        that is not over may be run again and goes on from its warp. KeyboardInterrupt passes through.
        """
        if self.over:
            return
        self._restart()
        start_ns, taken = self._clock.now_ns(), 0
        with ExitStack() as stack:
            stack.callback(self._finish)
            if self.live:
                self._garbage = stack.enter_context(PausedGC())
            while not (self.over or self._stop):
                enough = frames is not None and taken >= frames
                if enough or (seconds is not None and self._clock.now_ns() - start_ns >= 1e9 * seconds):
                    break
                step = self.step()
                taken += step.frame_number is not None
                yield step

    def _restart(self) -> None:
        """Begin a run; where one has ended before, its warp is kept."""
        if self.status.state is State.STOPPED:
            self._check.resume()
            self.status = Status()
            self._stop = False
            self._watch.restart()

    def _finish(self) -> None:
        self._garbage = None
        if not self.over:
            self.status = next_status(self.status, StepOutcome(Outcome.STOP, "the run has ended"))
        self._steps += 1
        self._screen.begin()
        self.ended = self._step(self._clock.now_ns(), ())

    def step(self) -> Step:
        """Wait for a frame, measure it, and show what it asks for."""
        self._steps += 1
        self._screen.begin()
        try:
            self._attend()
            if self._steps == 1:
                self._screen.draw()
            self._waiting = True
            came = self._source.next()
            self._waiting = False
            self._screen.frame_arrived()
        except Stopped:
            return self._without_frame(Trouble(Outcome.STOP, "the run was stopped"))
        except RAISED as error:
            return self._without_frame(failure(error))
        finally:
            self._waiting = False
        return self._without_frame(came) if isinstance(came, Trouble) else self._with_frame(came)

    def _attend(self) -> None:
        """Attend to keys, display and garbage; called in each step, and while it waits for the camera."""
        if self._stop and self._waiting:
            raise Stopped
        if self.on_wait is not None:
            self.on_wait()
        self._watch.poll()
        self._screen.repaint_if_due()
        if self._garbage is not None:
            self._garbage.idle()

    def _with_frame(self, frame: Frame) -> Step:
        started = time.perf_counter()
        frame = self._check.timed(frame)
        now_ns, frozen = self._clock.now_ns(), self._frozen or self.paused
        verdict = self._check.look_at(frame, now_ns, self._watch.stale)
        self._circle.expect_touch(bool(self.coming))
        result = FrameResult() if verdict.refusal else self._circle.take(frame, frozen)
        loop_ms = 1e3 * (time.perf_counter() - started)
        events, refusal = verdict.events, verdict.refusal
        if result.refusal is not None:
            events, refusal = (*events, result.refusal), Notice.refusal(result.refusal)
        trouble = self._show(result, refusal, frozen, now_ns)  # before it is judged, which takes longer
        self._circle.learn_pending()
        events += self._judged(frame, result)
        if result.coded:
            events += (Event.BURST,)
            self._notices.add(Notice(Event.BURST, burst_words(result)))
        state = self.paused, partial(self._at_rest, result), self.bench.doubt or self.doubt, self._passive
        outcome = frame_outcome(verdict, result, refusal, events, *state, self.coming)
        self.over |= verdict.wrong and self._check.wrong_frames >= WRONG_FRAMES_TO_END
        if trouble is not None:
            events += trouble.events
            outcome = StepOutcome(trouble.outcome, trouble.reason)
        self._notices.add_events(events, refusal.words if refusal else "")
        self.status = next_status(self.status, outcome)
        if not self._referenced and sees_target(self.status.state, result.residual_rms_px):
            self._circle.take_reference(result)  # later light is compared with that of the first nulled frame
            self._referenced = True
        if resting := self.status.state is State.RESTING:
            self._circle.learn_rest(result)
        if (zeroed := self._zero.take(result.believed, result.residual_rms_px, resting)) is not None:
            events += (zeroed.event,)
            self._notices.add_always(zeroed)
        return self._step(
            now_ns if verdict.wrong else frame.time_ns,
            events,
            frozen=frozen,
            measured=result.measured_from(self._zero.q),
            loop_ms=loop_ms,
            **self._screen.timing_ms(),
            **frame_figures(frame, verdict, result),
        )

    def _judged(self, frame: Frame, result: FrameResult) -> tuple[Event, ...]:
        """Events of light that spoils the measurement, and of a bench that moved."""
        if result.residual is None:
            return ()
        notices = [*self._quality.look(result.residual, frame), *self.bench.look(frame.image, result)]
        for notice in notices:
            self._notices.add(notice)
        return tuple(notice.event for notice in notices)

    def _at_rest(self, result: FrameResult) -> bool:
        """Whether the mirror is untouched; only asked, and worked out, where the loop is about to lock."""
        if result.measured is None or not self.status.locks_next:
            return False
        return self._zero.at_rest(self._circle.controller.estimate, result.measured)

    def _show(self, result: FrameResult, refusal: Notice | None, frozen: bool, now_ns: int) -> Trouble | None:
        """Have the command drawn; what went wrong, where something did."""
        if (dwell := self._screen.dwell) is not None and not frozen:
            dwell.note(refusal is not None, result.residual_rms_px)
        try:
            self._screen.offer(result.changed, frozen, now_ns)
        except RAISED as error:
            self.over = True
            return failure(error)
        return None

    def _without_frame(self, trouble: Trouble) -> Step:
        if Event.CAMERA_REOPENED in trouble.events:
            self._check.restart()
        self.over = trouble.ends
        self._notices.add_events(trouble.events, trouble.reason)
        self.status = next_status(self.status, StepOutcome(trouble.outcome, trouble.reason))
        return self._step(self._clock.now_ns(), trouble.events)

    def _step(self, time_ns: int, events: tuple[Event, ...], **figures: Any) -> Step:
        for notice in self._watch.look(self._clock.now_ns()):
            events += (notice.event,)
            self._notices.add(notice)
        self._start_ns = time_ns if self._start_ns is None else self._start_ns
        return Step(
            number=self._steps,
            time_ns=time_ns,
            time_s=1e-9 * (time_ns - self._start_ns),
            state=self.status.state,
            reason=self.status.reason,
            events=events,
            notes=self._notices.take(),
            calibrated=self.doubt is None or self.doubt.state is not State.UNCALIBRATED,
            commanded=self._circle.commanded,
            filtered=self._circle.controller.filtered(time_ns).less(self._zero.q),
            presented=tuple(self._screen.presented),
            presented_before=self._screen.presented_before,
            zero=self._zero.q,
            **figures,
        )
