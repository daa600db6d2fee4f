"""The loop: camera in, circle round, display out, and what to do when one of them fails."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.protocols import Camera, Display, DisplayLost, Frame
from zeromethod.exposure.delay import DelayWatch
from zeromethod.loop.assembly import assemble
from zeromethod.loop.circle import Sensor, Taken
from zeromethod.loop.display_watch import Watch
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.events import Event
from zeromethod.loop.frame_check import FrameCheck, Verdict, own
from zeromethod.loop.frame_source import FrameSource, Trouble
from zeromethod.loop.light_quality import LightQuality
from zeromethod.loop.live.paused_gc import PausedGC
from zeromethod.loop.notices import Notices
from zeromethod.loop.pattern_dwell import Hold
from zeromethod.loop.state import LOCK_FRAMES, NULLED, Outcome, Status, Turn, next_status
from zeromethod.loop.step import Step
from zeromethod.loop.zero import ZeroTaking
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

REPAINT_S = 1.0
"""In the host's time a picture is drawn anew after so long: what covered or blanked the LCD may be gone, but
nothing new to show comes of a dark frame."""

WRONG_FRAMES_TO_END = 10
"""Frames of wrong shape or type running after which the run ends."""


class Loop:
    """Nulls what the camera sees, one frame per `step`; see `zeromethod.loop.state` for its states.

    In simulated time everything happens in turn, in the caller's thread. In the host's (`HostClock`) the
    camera is read and the display is drawn in threads of their own, newest only, and nothing that a device
    does keeps a step from returning: use it as a context, or `close` it, to end them.

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
        self.live = isinstance(clock, HostClock)
        parts = assemble(rig, display, optics or Optics(rig), sensor, self.live)
        self.rest = parts.rest
        self.status = Status()
        self.over = False
        self.every_turn: Callable[[], None] | None = None
        """Called in the loop's thread once per turn, and while one waits: for keys, buttons, windows."""
        self.ended: Step | None = None
        """What is left at the end of `run`: the last state, and nothing measured."""
        self._clock = clock
        self._circle = parts.circle
        self._drawing = parts.drawing
        timeout_s = rig.control.timeout_s
        timed = parts.circle.delay is not None
        self._hold = Hold(1e9 / rig.camera.rate_hz, timed) if self.live or timed else None
        self._watch = Watch(display, timeout_s if self.live else None)
        meanwhile = self._attend if self.live else None
        self._source = FrameSource(camera, reopen_camera, clock, timeout_s, meanwhile)
        self._check = FrameCheck(rig.camera)
        self._quality = LightQuality(self.rest.seen, rig.camera.noise.black_grey)
        self._notices = Notices()
        self._paused_gc: PausedGC | None = None
        self._wrong_frames = 0
        self._steps = 0
        self._held = False
        self._paused = False
        self._waiting = False
        self._unshown = False
        self._posted_ns = 0
        self._presented: list[Drawn] = []
        self._presented_before = 0
        self._taking: ZeroTaking | None = None
        self._zero: Float | None = None
        self._referenced = False
        self._stop = False

    @property
    def grid(self) -> NodeGrid:
        """The nodes."""
        return self.rest.grid

    @property
    def q_rest(self) -> Float:
        """(rows, cols, 2) warp of the untouched mirror, LCD px."""
        return self.rest.q

    @property
    def gl_renderer(self) -> str:
        """Name of what draws the pattern, as GL gives it."""
        return self._drawing.gl_renderer

    @property
    def delay(self) -> DelayWatch | None:
        """What the coded strips tell of the delay; None without strips."""
        return self._circle.delay

    @property
    def horizon_s(self) -> float:
        """From a frame's mid-exposure to that of those that see what was made of it; NaN: not known yet."""
        return self._circle.horizon_s

    def hold(self, on: bool = True) -> None:
        """Keep the command as it is while `on`; frames are measured all the same."""
        self._held = on

    def pause(self, on: bool = True) -> None:
        """Hold, by the operator's wish: the state is PAUSED until `resume`."""
        self._paused = on

    def resume(self) -> None:
        """Go on correcting."""
        self._paused = False

    @property
    def paused(self) -> bool:
        """Whether corrections are paused."""
        return self._paused

    def rezero(self) -> None:
        """Take the mean warp of the next nulled frames as that of the untouched mirror, for all readings.

        It ends in a step with the event ZERO_TAKEN, or ZERO_REFUSED and why in its notes: see
        `zeromethod.loop.zero`. What is shown does not change by it.
        """
        self._taking = ZeroTaking(self.rest)

    @property
    def zero(self) -> Float | None:
        """(rows, cols, 2) LCD px, the warp that readings start from less the rig's at rest; None for 0."""
        return self._zero

    def stop(self) -> None:
        """End the run after the present step, and that one at once if it waits."""
        self._stop = True

    def close(self) -> None:
        """End the loop's threads, within half a second; may be called again. The devices stay open."""
        self._source.close()
        self._drawing.close()

    def __enter__(self) -> Loop:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def run(self, frames: int | None = None, seconds: float | None = None) -> Generator[Step]:
        """Step until `frames` frames or `seconds` (of the run's clock) have passed, or the loop is over.

        Ends STOPPED, or in FAULT when a device was lost for good, and closed. KeyboardInterrupt passes
        through.
        """
        start_ns = self._clock.now_ns()
        taken = 0
        with ExitStack() as stack:
            stack.callback(self._finish)
            if self.live:
                self._paused_gc = stack.enter_context(PausedGC())
            while not (self.over or self._stop):
                if frames is not None and taken >= frames:
                    break
                if seconds is not None and self._clock.now_ns() - start_ns >= 1e9 * seconds:
                    break
                step = self.step()
                taken += step.frame_number is not None
                yield step

    def _finish(self) -> None:
        self._paused_gc = None
        if not self.over:
            self._end(Turn(Outcome.STOP, "the run has ended"))
        self._begin()
        self.ended = self._step(self._clock.now_ns(), ())
        self.close()

    def _begin(self) -> None:
        self._steps += 1
        self._presented, self._presented_before = [], 0

    def _end(self, turn: Turn) -> None:
        self.status = next_status(self.status, turn)
        self.over = True

    def step(self) -> Step:
        """One turn: wait for a frame, measure it, show what it asks for."""
        self._begin()
        try:
            self._attend()
            if self._steps == 1:
                self._present()
            self._waiting = True
            came = self._source.next()
            self._waiting = False
            self._note_presented()
            self._presented_before = len(self._presented)
        except _Stopped:
            return self._without_frame(Trouble(Outcome.STOP, "the run was stopped", ends=True))
        except Exception as error:
            return self._without_frame(self._failed(error))
        finally:
            self._waiting = False
        return self._without_frame(came) if isinstance(came, Trouble) else self._with_frame(came)

    def _attend(self) -> None:
        """Do what must not wait for the camera."""
        if self._stop and self._waiting:
            raise _Stopped
        if self.every_turn is not None:
            self.every_turn()
        self._watch.poll()
        if self.live and self._posted_ns and self._clock.now_ns() - self._posted_ns > 1e9 * REPAINT_S:
            self._present()
        if self._paused_gc is not None:
            self._paused_gc.idle()

    def _with_frame(self, frame: Frame) -> Step:
        started = time.perf_counter()
        frame = self._check.timed(frame)
        now_ns = self._clock.now_ns()
        verdict = self._check.look_at(frame, now_ns)
        if not verdict.fault and (stale := self._watch.stale(now_ns)):
            verdict = replace(verdict, fault=stale)
        held = self._held or self._paused
        taken = Taken(held=verdict.fault) if verdict.fault else self._circle.take(own(frame), held)
        loop_ms = 1e3 * (time.perf_counter() - started)
        events = verdict.events + taken.events
        if taken.seen is not None:
            for event, words in self._quality.look(taken.seen.residual, frame.time_ns):
                events += (event,)
                self._notices.tell(event, words)
        turn = self._turn(verdict, taken, events)
        if self._hold is not None and not held:
            self._hold.note(bool(taken.held), taken.residual_rms_px)
        if taken.changed:
            self._unshown = True
        if self._unshown and not held and (self._hold is None or self._hold.may_present(now_ns)):
            try:
                self._present()
                self._note_presented()
            except Exception as error:
                trouble = self._failed(error)
                events += trouble.events
                turn = Turn(trouble.outcome, trouble.reason)
                self.over = True
        self._notices.tell_all(events, verdict.fault or taken.held)
        self.status = next_status(self.status, turn)
        if not self._referenced and self.status.state in NULLED:
            self._circle.take_reference(taken)
            self._referenced = True
        measured = None if Event.PICTURES_MIXED in taken.events else taken.measured
        if self._taking is not None:
            events += self._take_zero(self._taking, measured, taken.residual_rms_px)
        draw_ms = delay_ms = float("nan")
        if self._presented:
            newest = self._presented[-1]
            draw_ms = newest.draw_ms
            if newest.seen_ns is not None:
                lit_ns = newest.time_ns + self._circle.timing.half_lit_ns
                delay_ms = 1e-6 * (lit_ns - newest.seen_ns)
        return self._step(
            now_ns if verdict.wrong else frame.time_ns,
            events,
            frame_number=frame.number,
            dropped=0 if verdict.wrong else frame.dropped,
            exposure_ns=0 if verdict.wrong else frame.exposure_ns,
            held=held,
            sensed=not verdict.fault,
            image=frame.image,
            residual=taken.seen.residual.copy() if taken.seen else None,
            shown_q=taken.seen.shown.q.copy() if taken.seen else None,
            measured=None if measured is None else self._from_zero(measured),
            residual_rms_px=taken.residual_rms_px,
            valid_share=taken.valid_share,
            loop_ms=loop_ms,
            draw_ms=draw_ms,
            delay_ms=delay_ms,
        )

    def _turn(self, verdict: Verdict, taken: Taken, events: tuple[Event, ...]) -> Turn:
        """Tell what a frame means for the state."""
        self._wrong_frames = self._wrong_frames + 1 if verdict.wrong else 0
        if verdict.wrong:
            self.over = self._wrong_frames >= WRONG_FRAMES_TO_END
            return Turn(Outcome.FAILED, verdict.fault)
        if Event.LIGHT_OFF in taken.events:
            return Turn(Outcome.MEASURED, taken.held)
        if self._paused:
            return Turn(Outcome.PAUSED, "paused: frames are measured, the picture stays")
        if taken.held or taken.measured is None:
            return Turn(Outcome.HELD, taken.held)
        # Whether it rests only matters, and is only worked out, where the loop is about to be locked.
        locked = self.status.nulled_frames + 1 >= LOCK_FRAMES
        rest_q = None if self._zero is None else self.rest.q + self._zero
        at_rest = locked and self._circle.at_rest(taken.measured, rest_q)
        blinded = "the camera is blinded: too bright" if Event.SATURATED in events else ""
        return Turn(Outcome.MEASURED, blinded, taken.residual_rms_px, taken.valid_share, at_rest)

    def _present(self) -> None:
        self._unshown = False
        self._posted_ns = self._clock.now_ns()
        self._drawing.post(self._circle.controller.commanded, self._circle.seen_ns)

    def _note_presented(self) -> None:
        for one in self._drawing.collect():
            self._circle.presented(one.time_ns, one.q, one.code, seen_ns=one.seen_ns)
            if self._hold is not None:
                self._hold.presented(one.time_ns)
            self._presented.append(one)

    def _take_zero(
        self, taking: ZeroTaking, measured: Warp | None, residual_rms_px: float
    ) -> tuple[Event, ...]:
        found = taking.take(measured, residual_rms_px)
        if found is None:
            return ()
        self._taking = None
        if isinstance(found, str):
            self._notices.say(f"no new zero: {found}")
            return (Event.ZERO_REFUSED,)
        drift = float(np.sqrt(np.mean(np.sum(found[self.rest.seen] ** 2, axis=-1))))
        self._zero = found
        self._notices.say(f"readings start anew from here, {drift:.2f} LCD px (rms) from the rig file's rest")
        return (Event.ZERO_TAKEN,)

    def _from_zero(self, warp: Warp) -> Warp:
        return warp if self._zero is None else replace(warp, q=warp.q - self._zero)

    def _failed(self, error: Exception) -> Trouble:
        """End on a lost display, or on what no device may raise: the driver is named, and nothing is lost."""
        if isinstance(error, DisplayLost):
            return Trouble(Outcome.FAILED, f"the display is lost: {error}", (Event.DISPLAY_LOST,), ends=True)
        where = traceback.extract_tb(error.__traceback__)[-1]
        told = " ".join(str(error).split()) or "no message"
        reason = f"{type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {told}"
        return Trouble(Outcome.FAILED, reason, (Event.DEVICE_BROKEN,), ends=True)

    def _without_frame(self, trouble: Trouble) -> Step:
        if Event.CAMERA_REOPENED in trouble.events:
            self._check.restart()
        self.over = trouble.ends
        self._notices.tell_all(trouble.events, trouble.reason)
        self.status = next_status(self.status, Turn(trouble.outcome, trouble.reason))
        return self._step(self._clock.now_ns(), trouble.events)

    def _step(self, time_ns: int, events: tuple[Event, ...], **figures: Any) -> Step:
        for event, words in self._watch.look(self._clock.now_ns()):
            events += (event,)
            self._notices.tell(event, words)
        filtered = self._circle.controller.filtered(time_ns)
        return Step(
            number=self._steps,
            time_ns=time_ns,
            state=self.status.state,
            reason=self.status.reason,
            events=events,
            notes=self._notices.take(),
            commanded_q=self._circle.controller.commanded,
            filtered=self._from_zero(filtered),
            presented=tuple(self._presented),
            presented_before=self._presented_before,
            zero=self._zero,
            **figures,
        )


class _Stopped(Exception):
    """The loop was asked to stop while it waited."""
