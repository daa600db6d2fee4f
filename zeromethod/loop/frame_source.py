"""Frames from a camera that may time out, hang or vanish: the next frame, or what is wrong."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

from zeromethod.clock import Clock
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout, DisplayLost, Frame
from zeromethod.loop.events import Event
from zeromethod.loop.live.capture import Capture
from zeromethod.loop.live.reopening import Reopener
from zeromethod.loop.state import Outcome

TIMEOUTS_TO_STALL = 3
"""Consecutive read timeouts after which the camera counts as stalled."""


@dataclass(frozen=True)
class Trouble:
    """A step without a usable frame. `ends`: nothing more can be done."""

    outcome: Outcome
    reason: str
    events: tuple[Event, ...] = ()
    ends: bool = False


def failure(error: Exception) -> Trouble:
    """End on a lost display, or on what no device may raise: the driver is named, and nothing is lost."""
    if isinstance(error, DisplayLost):
        return Trouble(Outcome.FAILED, f"the display is lost: {error}", (Event.DISPLAY_LOST,), ends=True)
    where = traceback.extract_tb(error.__traceback__)[-1]
    words = " ".join(str(error).split()) or "no message"
    reason = f"{type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {words}"
    return Trouble(Outcome.FAILED, reason, (Event.DEVICE_BROKEN,), ends=True)


def _check_members(frame: Frame) -> None:
    """Refuse what lacks a frame's members; frames may be of any class."""
    missing = [field.name for field in fields(Frame) if not hasattr(frame, field.name)]
    if missing:
        raise TypeError(f"read() gave {type(frame).__name__}, which lacks {', '.join(missing)}")


class FrameSource:
    """A camera, opened again when it is lost. Errors that a camera may not raise pass through."""

    def __init__(
        self,
        camera: Camera,
        reopen: Callable[[], Camera] | None,
        clock: Clock,
        timeout_s: float,
        meanwhile: Callable[[], None] | None,
    ) -> None:
        """meanwhile: called while waiting, see `Capture`; None: the camera is read in the caller's thread."""
        self._meanwhile = meanwhile
        self._timeout_s = timeout_s
        self._camera = self._guarded(camera)
        self._reopener = Reopener(reopen, clock, live=meanwhile is not None)
        self._timeouts = 0
        self._lost: str | None = None

    def next(self) -> Frame | Trouble:
        """Wait for the next frame."""
        if self._lost is not None:
            return self._reopen(self._lost)
        try:
            frame = self._camera.read(self._timeout_s)
        except CameraTimeout:
            return self._timed_out()
        except CameraLost as error:
            return self._gone(f"the camera is lost: {error}", Event.CAMERA_LOST)
        _check_members(frame)
        self._timeouts = 0
        return frame

    def close(self) -> None:
        """End reading and reopening; the camera stays open."""
        self._read_no_more()
        self._reopener.close()

    def _read_no_more(self) -> None:
        if isinstance(self._camera, Capture):
            self._camera.close()

    def _guarded(self, camera: Camera) -> Camera | Capture:
        return camera if self._meanwhile is None else Capture(camera, self._meanwhile)

    def _timed_out(self) -> Trouble:
        self._timeouts += 1
        waited = f"no frame for {self._timeouts * self._timeout_s:g} s"
        if self._timeouts < TIMEOUTS_TO_STALL:
            return Trouble(Outcome.HELD, waited, (Event.CAMERA_TIMEOUT,))
        return self._gone(f"the camera is stalled: {waited}", Event.CAMERA_STALLED)

    def _gone(self, reason: str, event: Event) -> Trouble:
        self._lost = reason
        self._read_no_more()
        return Trouble(Outcome.FAILED, reason, (event,), ends=self._reopener.exhausted)

    def _reopen(self, lost: str) -> Trouble:
        camera = self._reopener.attempt()
        if camera is not None:
            self._camera = self._guarded(camera)
            self._lost = None
            self._timeouts = 0
            return Trouble(Outcome.HELD, "the camera was opened again", (Event.CAMERA_REOPENED,))
        plan = self._reopener.plan
        if not plan:
            why = self._reopener.failure
            plan = "it could not be opened again" + (f": {why}" if why else "")
        return Trouble(Outcome.FAILED, f"{lost}; {plan}", ends=self._reopener.exhausted)
