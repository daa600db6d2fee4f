"""Opening a lost camera again, a bounded number of times."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable

from zeromethod.clock import Clock
from zeromethod.devices.bounded import call_within
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout
from zeromethod.errors import InputError

PER_MINUTE = 3
WAITS_S = (0.5, 2.0, 8.0)
"""Pause before the first, second and third attempt within a minute: a bus needs time to come back."""

OPENING_S = 10.0
"""A camera that takes longer to open counts as not opened."""

CLOSING_S = 0.2
"""How long one that came too late may take to close."""

SLICE_S = 0.1
"""How long a call of `LiveReopener.attempt` takes at most."""

FAILURES = (CameraLost, CameraTimeout, InputError)
"""What a driver may raise for a camera that is not there."""


class Reopener:
    """At most three attempts in any minute, further apart each time."""

    def __init__(self, reopen: Callable[[], Camera] | None, clock: Clock) -> None:
        self._reopen = reopen
        self._clock = clock
        self._attempts_ns: deque[int] = deque(maxlen=PER_MINUTE)
        self.failure = ""
        """Why the last attempt failed, in words; "" where the driver did not say."""

    @property
    def exhausted(self) -> bool:
        """Whether no attempt is under way or allowed now."""
        return self._reopen is None or self._recent() >= PER_MINUTE

    @property
    def plan(self) -> str:
        """What is being done about the camera, in words; "" for nothing."""
        return ""

    def close(self) -> None:
        """Attempt nothing more; a camera that is being opened is closed as soon as it is there."""
        self._reopen = None

    def _recent(self) -> int:
        since = self._clock.now_ns() - 60 * 10**9
        return sum(time_ns > since for time_ns in self._attempts_ns)

    def attempt(self) -> Camera | None:
        """Open the camera anew after a pause; None when that failed or is not allowed."""
        if self._reopen is None or self.exhausted:
            return None
        wait_s = WAITS_S[self._recent()]
        self._clock.sleep_until_ns(self._clock.now_ns() + round(1e9 * wait_s))
        self._attempts_ns.append(self._clock.now_ns())
        try:
            return self._reopen()
        except FAILURES as error:
            self.failure = _one_line(error)
            return None


class LiveReopener(Reopener):
    """The same attempts, a short call at a time: pauses are waited and cameras opened meanwhile."""

    def __init__(self, reopen: Callable[[], Camera] | None, clock: Clock) -> None:
        super().__init__(reopen, clock)
        self._due_ns: int | None = None
        self._opening: _Opening | None = None

    @property
    def exhausted(self) -> bool:
        """Whether no attempt is under way or allowed now."""
        return self._due_ns is None and self._opening is None and super().exhausted

    @property
    def plan(self) -> str:
        """What is being done about the camera, in words; "" for nothing."""
        number = f"attempt {self._recent() + (self._opening is None)} of {PER_MINUTE}"
        if self._opening is not None:
            return f"it is being opened again ({number})"
        if self._due_ns is not None:
            left_s = max(1e-9 * (self._due_ns - self._clock.now_ns()), 0.0)
            return f"it is opened again in {left_s:.0f} s ({number})"
        return ""

    def attempt(self) -> Camera | None:
        """Camera that was opened anew; None while that is waited for, when it failed or is not allowed."""
        if self._reopen is None or self.exhausted:
            return None
        if self._opening is None:
            now_ns = self._clock.now_ns()
            if self._due_ns is None:
                self._due_ns = now_ns + round(1e9 * WAITS_S[self._recent()])
            self._clock.sleep_until_ns(min(self._due_ns, now_ns + round(1e9 * SLICE_S)))
            if self._clock.now_ns() < self._due_ns:
                return None
            self._due_ns = None
            self._attempts_ns.append(self._clock.now_ns())
            self._opening = _Opening(self._reopen)
        done = self._opening.done.wait(SLICE_S)
        if not done and self._clock.now_ns() < self._attempts_ns[-1] + round(1e9 * OPENING_S):
            return None
        opening, self._opening = self._opening, None
        self.failure = opening.failure if done else f"not within {OPENING_S:g} s"
        return opening.take()

    def close(self) -> None:
        """Attempt nothing more; a camera that is being opened is closed as soon as it is there."""
        super().close()
        self._due_ns = None
        opening, self._opening = self._opening, None
        if opening is not None:
            opening.give_up()


class _Opening:
    """One attempt in a thread of its own."""

    def __init__(self, reopen: Callable[[], Camera]) -> None:
        self._reopen = reopen
        self._lock = threading.Lock()
        self._camera: Camera | None = None
        self._error: BaseException | None = None
        self._given_up = False
        self.failure = ""
        self.done = threading.Event()
        threading.Thread(target=self._run, name="camera opening", daemon=True).start()

    def _run(self) -> None:
        camera, error = None, None
        try:
            camera = self._reopen()
        except FAILURES as failed:
            self.failure = _one_line(failed)
        except BaseException as raised:  # whatever it is, it belongs to the thread that asked
            error = raised
        with self._lock:
            self._camera, self._error = camera, error
            late = self._given_up
        self.done.set()
        if late:
            _close(camera)

    def take(self) -> Camera | None:
        """Its camera, None where it failed or is not done: then it is closed as soon as it is there."""
        with self._lock:
            self._given_up = True
            if self._error is not None:
                raise self._error
            return self._camera

    def give_up(self) -> None:
        """Nobody wants its camera any more."""
        with self._lock:
            self._given_up = True
            camera = self._camera
        _close(camera)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _close(camera: Camera | None) -> None:
    if camera is not None:
        with contextlib.suppress(Exception):
            call_within(CLOSING_S, camera.close, "camera closing")
