"""Opening a lost camera again, a bounded number of times."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait

from zeromethod.clock import Clock
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout
from zeromethod.errors import InputError
from zeromethod.worker import call_within, completed, in_thread

PER_MINUTE = 3
WAITS_S = (0.5, 2.0, 8.0)
"""Pause before the first, second and third attempt within a minute: a bus needs time to come back."""

OPENING_S = 10.0
"""A camera that takes longer to open counts as not opened."""

CLOSING_S = 0.2
"""How long a camera that came too late may take to close."""

SLICE_S = 0.1
"""How long a live call of `Reopener.attempt` takes at most."""

FAILURES = (CameraLost, CameraTimeout, InputError)
"""What a driver may raise for a camera that is not there."""


class Reopener:
    """At most three attempts in any minute, further apart each time."""

    def __init__(self, reopen: Callable[[], Camera] | None, clock: Clock, live: bool) -> None:
        """live: attempt in short calls, the camera opened in a thread; else one call does it all."""
        self._reopen = reopen
        self._clock = clock
        self._live = live
        self._attempts_ns: deque[int] = deque(maxlen=PER_MINUTE)
        self._due_ns: int | None = None
        self._opening: Future[Camera] | None = None
        self.failure = ""
        """Why the last attempt failed, in words; "" where the driver did not say."""

    @property
    def exhausted(self) -> bool:
        """Whether no attempt is under way or allowed now."""
        pending = self._due_ns is not None or self._opening is not None
        return not pending and (self._reopen is None or self._recent() >= PER_MINUTE)

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
        """The reopened camera; None when that failed, is not allowed or, live, is still awaited."""
        if self._reopen is None or self.exhausted:
            return None
        if self._opening is None:
            now_ns = self._clock.now_ns()
            if self._due_ns is None:
                self._due_ns = now_ns + round(1e9 * WAITS_S[self._recent()])
            slice_end_ns = now_ns + round(1e9 * SLICE_S)
            self._clock.sleep_until_ns(min(self._due_ns, slice_end_ns) if self._live else self._due_ns)
            if self._clock.now_ns() < self._due_ns:
                return None
            self._due_ns = None
            self._attempts_ns.append(self._clock.now_ns())
            self._opening = (
                in_thread("camera opening", self._reopen) if self._live else completed(self._reopen)
            )
        done = wait([self._opening], SLICE_S).done
        if not done and self._clock.now_ns() < self._attempts_ns[-1] + round(1e9 * OPENING_S):
            return None
        opening, self._opening = self._opening, None
        if not done:
            self.failure = f"not within {OPENING_S:g} s"
            opening.add_done_callback(_close)
            return None
        try:
            return opening.result()
        except FAILURES as error:
            self.failure = " ".join(str(error).split())
            return None

    def close(self) -> None:
        """Make no more attempts; a camera that is being opened is closed as soon as it is there."""
        self._reopen = self._due_ns = None
        opening, self._opening = self._opening, None
        if opening is not None:
            opening.add_done_callback(_close)

    def _recent(self) -> int:
        since = self._clock.now_ns() - 60 * 10**9
        return sum(time_ns > since for time_ns in self._attempts_ns)


def _close(opening: Future[Camera]) -> None:
    """Close a camera that nobody waits for any more."""
    with contextlib.suppress(Exception):
        call_within(CLOSING_S, opening.result().close, "camera closing")
