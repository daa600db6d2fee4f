"""Frames from a camera that may time out, hang or vanish: the next frame, or what is wrong."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from zeromethod.clock import Clock
from zeromethod.devices.contract import said_by, taken
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout, DisplayLost, Frame, gives_buffers
from zeromethod.loop.events import Event
from zeromethod.loop.reopening import Reopener
from zeromethod.loop.state import Outcome
from zeromethod.worker import Worker, completed

TIMEOUTS_TO_STALL = 3
"""Consecutive read timeouts after which the camera counts as stalled."""


SLICE_S = 0.05
"""How often the waiting thread attends to what else there is to do."""

GRACE_S = 0.1
"""How much later than its time-out a camera's own answer may come."""


@dataclass(frozen=True)
class Trouble:
    """A step without a usable frame. `ends`: nothing more can be done."""

    outcome: Outcome
    reason: str
    events: tuple[Event, ...] = ()
    ends: bool = False


class Stopped(Exception):
    """The wait for a frame is to end; raised by what is called meanwhile."""


def failure(error: BaseException) -> Trouble:
    """End on a lost display, or on what no device may raise: the driver is named, and nothing is lost."""
    if isinstance(error, DisplayLost):
        return Trouble(Outcome.FAILED, f"the display is lost: {error}", (Event.DISPLAY_LOST,), ends=True)
    where = traceback.extract_tb(error.__traceback__)[-1]
    words = said_by(error) or "no message"
    reason = f"{type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {words}"
    return Trouble(Outcome.FAILED, reason, (Event.DEVICE_BROKEN,), ends=True)


class Capture:
    """Reads one camera from one thread, a frame at a time, once the previous one has been dealt with.

    A camera without a thread of its own is read at the same moments as without this one; the thread adds
    some 0.1 ms to each frame. A read that never ends is left to its thread.
    """

    def __init__(self, camera: Camera, meanwhile: Callable[[], None]) -> None:
        """meanwhile: called every `SLICE_S` in the thread that waits; what it raises passes."""
        self._meanwhile = meanwhile

        def answer(timeout_s: float) -> Future[Frame]:
            return completed(lambda: taken(camera.read, timeout_s))

        self._worker: Worker[float, Future[Frame]] = Worker("capture", lambda: nullcontext(answer))
        self._asked = False

    @gives_buffers
    def read(self, timeout_s: float) -> Frame:
        """Newest frame; raises what the camera raises, or CameraTimeout when it does not answer in time.

        An answer that comes too late is returned by the next call, unless it is a CameraTimeout.
        """
        end_s = time.monotonic() + timeout_s + GRACE_S
        late = self._asked
        if not self._asked:
            self._ask(timeout_s)
        while (left_s := end_s - time.monotonic()) > 0:
            for answer in self._worker.take(min(left_s, SLICE_S)):
                self._asked = False
                if not (late and isinstance(answer.exception(), CameraTimeout)):
                    return answer.result()
                # the answer to the previous call, which did not wait for it
                late = False
                self._ask(max(end_s - GRACE_S - time.monotonic(), SLICE_S))
            self._meanwhile()
        raise CameraTimeout(f"no answer within {timeout_s:g} s")

    def close(self) -> None:
        """End the thread, as soon as the camera answers; the camera stays open."""
        self._worker.close(0.0)

    def _ask(self, timeout_s: float) -> None:
        self._asked = True
        self._worker.post(timeout_s)


class FrameSource:
    """A camera, opened again when it is lost. Errors that a camera may not raise pass through."""

    def __init__(
        self,
        camera: Camera,
        reopen: Callable[[], Camera] | None,
        clock: Clock,
        timeout_s: float,
        meanwhile: Callable[[], None] | None,
        reopen_s: float,
    ) -> None:
        """reopen_s: how long a lost camera is tried again.

        meanwhile: called while waiting, see `Capture`; None: the camera is read in the caller's thread.
        """
        self._meanwhile = meanwhile
        self._timeout_s = timeout_s
        self._camera = self._guarded(camera)
        self._reopener = Reopener(reopen, clock, live=meanwhile is not None, for_s=reopen_s)
        self._timeouts = 0
        self._lost: str | None = None

    def next(self) -> Frame | Trouble:
        """Wait for the next frame."""
        if self._lost is not None:
            return self._reopen(self._lost)
        try:
            frame = taken(self._camera.read, self._timeout_s)
        except CameraTimeout:
            return self._timed_out()
        except CameraLost as error:
            return self._gone(f"the camera is lost: {error}", Event.CAMERA_LOST)
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
