"""The watch camera of a run, read in a thread of its own at its own rate; its faults never stop the run."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from zeromethod.approach.approach import FAULTY, Approach, Watching
from zeromethod.approach.reader import WatchReader
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.contract import RAISED, said_by, taken, wrong_numbers
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout
from zeromethod.rig.model import Rig
from zeromethod.worker import SameThread, Worker

STALLED_S = 0.5
"""Without a new frame for so long, or for ten frames if that is longer, the watch camera is stalled."""
REOPEN_S = 1.0
"""Pause between attempts to open a lost one again."""
CLOSING_S = 0.3


class Watch:
    """The watch camera of a run; `look`, called once per step, gives its newest result and never waits.

    In simulated time there is no thread: the frame that is due is read by `look`.
    """

    def __init__(self, rig: Rig, clock: Clock, open_camera: Callable[[], Camera]) -> None:
        """Open the camera; raises InputError as that does, and for a rig that sees nothing by it."""
        assert rig.watch is not None
        self._reader = WatchReader(rig)
        self._rig, self._clock, self._open = rig, clock, open_camera
        self._camera: Camera | None = open_camera()
        self._stalled_s = max(STALLED_S, 10.0 / rig.watch.rate_hz)
        self._frame_ns = self._tried_ns = clock.now_ns()
        self._newest = Approach(watching=Watching.STARTING)
        self._noted = Watching.STARTING
        live = isinstance(clock, HostClock)
        self._wait_s = 0.25 if live else 0.0
        self._worker: Worker[None, Approach] | SameThread[None, Approach] = (
            Worker("watch", self._serving, kept=1, idle=(0.0, None)) if live else SameThread(self._serving)
        )

    def look(self) -> Approach:
        """The newest of what comes; stalled where the camera hangs."""
        if isinstance(self._worker, SameThread):
            self._worker.post(None)
        answers = self._worker.take()
        if answers:
            self._newest = answers[-1]
        elif self._worker.busy_s > self._stalled_s + self._wait_s:
            self._newest = Approach(watching=Watching.STALLED, reason="it does not answer")
        return self._newest

    def note(self) -> tuple[str, ...]:
        """A line for the operator when the watch camera fails, and when it is back."""
        before, self._noted = self._noted, self._newest.watching
        if self._noted is before or not {self._noted, before} & FAULTY:
            return ()
        failed = self._noted in FAULTY
        return (f"{self._newest.words}: what comes is not seen" if failed else "watch camera: back",)

    def close(self) -> None:
        """End the thread, which closes the camera; a camera that hangs is left to it."""
        self._worker.close(CLOSING_S)

    @contextmanager
    def _serving(self) -> Generator[Callable[[None], Approach | None]]:
        try:
            yield lambda _: self._next()
        finally:
            self._close_camera()

    def _close_camera(self) -> None:
        camera, self._camera = self._camera, None
        with suppress(*RAISED):
            if camera is not None:
                camera.close()

    def _next(self) -> Approach | None:
        """What the next frame says; None for nothing new."""
        now_ns = self._clock.now_ns()
        try:
            if self._camera is None:
                if now_ns - self._tried_ns < 1e9 * REOPEN_S:
                    self._clock.sleep_until_ns(now_ns + round(1e9 * self._wait_s))
                    return None
                self._camera, self._frame_ns = self._open(), now_ns
            frame = taken(self._camera.read, self._wait_s)
            if wrong := wrong_numbers(frame):
                raise CameraLost(wrong)
        except CameraTimeout:
            if now_ns - self._frame_ns <= 1e9 * self._stalled_s:
                return None
            return Approach(watching=Watching.STALLED, time_ns=now_ns, reason="no new frame")
        except RAISED as error:  # of any kind: the run does not depend on this camera
            self._close_camera()
            self._tried_ns = now_ns
            words = said_by(error) or type(error).__name__
            kind = "" if isinstance(error, CameraLost) else f"{type(error).__name__}: "
            return Approach(watching=Watching.LOST, time_ns=now_ns, reason=kind + words)
        self._frame_ns = now_ns
        try:
            return self._reader.take(frame.image, frame.time_ns)
        except Exception as error:  # nor does it depend on what its frames are read by
            self._reader = WatchReader(self._rig)
            words = f"{type(error).__name__}: {error}"
            return Approach(watching=Watching.BLIND, time_ns=frame.time_ns, reason=words)
