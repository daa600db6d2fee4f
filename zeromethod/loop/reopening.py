"""Opening a lost camera again, for a bounded time."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, wait

from zeromethod.clock import Clock
from zeromethod.devices.contract import RAISED, said_by
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout
from zeromethod.errors import InputError
from zeromethod.worker import call_within, completed, in_thread

PER_MINUTE = 3
"""A camera that was opened again so often within a minute, and is lost yet again, is not opened any more."""

WAITS_S = (0.5, 2.0, 8.0)
"""Pause before the first, second, and every further attempt: a bus needs time to come back."""

OPENING_S = 10.0
"""A camera that takes longer to open counts as not opened."""

CLOSING_S = 0.2
"""How long a camera that came too late may take to close."""

SLICE_S = 0.1
"""How long a live call of `Reopener.attempt` takes at most."""

FAILURES = (CameraLost, CameraTimeout, InputError)
"""What a driver may raise for a camera that is not there."""


class Reopener:
    """Attempts, further apart each time, until a camera has been gone for `for_s`."""

    def __init__(self, reopen: Callable[[], Camera] | None, clock: Clock, live: bool, for_s: float) -> None:
        """live: attempt in short calls, the camera opened in a thread; else one call does it all."""
        self._reopen = reopen
        self._clock = clock
        self._live = live
        self._for_ns = round(1e9 * for_s)
        self._gone_ns: int | None = None
        self._attempts = 0
        self._attempt_ns = 0
        self._opened_ns: deque[int] = deque(maxlen=PER_MINUTE)
        self._due_ns: int | None = None
        self._opening: Future[Camera] | None = None
        self.failure = ""
        """Why the last attempt failed, in words; "" where the driver did not say."""

    @property
    def exhausted(self) -> bool:
        """Whether no attempt is under way or allowed now."""
        if self._due_ns is not None or self._opening is not None:
            return False
        if self._reopen is None:
            return True
        if self._gone_ns is not None:
            return self._attempts > 0 and self._clock.now_ns() >= self._gone_ns + self._for_ns
        since = self._clock.now_ns() - 60 * 10**9
        return sum(time_ns > since for time_ns in self._opened_ns) >= PER_MINUTE

    @property
    def plan(self) -> str:
        """What is being done about the camera, in words; "" for nothing."""
        if self._opening is not None:
            return f"it is being opened again (attempt {self._attempts})"
        if self._due_ns is not None and self._gone_ns is not None:
            now_ns = self._clock.now_ns()
            left_s = max(1e-9 * (self._due_ns - now_ns), 0.0)
            more_s = max(1e-9 * (self._gone_ns + self._for_ns - now_ns), 0.0)
            attempt = f"attempt {self._attempts + 1}, for {more_s:.0f} s more"
            return f"it is opened again in {left_s:.0f} s ({attempt})"
        return ""

    def attempt(self) -> Camera | None:
        """The reopened camera; None when that failed, is not allowed or, live, is still awaited."""
        if self._reopen is None or self.exhausted:
            return None
        if self._opening is None and not self._begun(self._reopen):
            return None
        assert self._opening is not None
        done = wait([self._opening], SLICE_S).done
        if not done and self._clock.now_ns() < self._attempt_ns + round(1e9 * OPENING_S):
            return None
        opening, self._opening = self._opening, None
        if not done:
            self.failure = f"not within {OPENING_S:g} s"
            opening.add_done_callback(_close)
            return None
        try:
            camera = opening.result()
        except FAILURES as error:
            self.failure = said_by(error)
            return None
        self._gone_ns, self._attempts = None, 0
        self._opened_ns.append(self._clock.now_ns())
        return camera

    def _begun(self, reopen: Callable[[], Camera]) -> bool:
        """Wait until the next attempt is due, and begin it."""
        now_ns = self._clock.now_ns()
        if self._gone_ns is None:
            self._gone_ns = now_ns
        if self._due_ns is None:
            due_ns = now_ns + round(1e9 * WAITS_S[min(self._attempts, len(WAITS_S) - 1)])
            # the last attempt comes when the time is up
            self._due_ns = max(min(due_ns, self._gone_ns + self._for_ns), now_ns)
        slice_end_ns = now_ns + round(1e9 * SLICE_S)
        self._clock.sleep_until_ns(min(self._due_ns, slice_end_ns) if self._live else self._due_ns)
        if self._clock.now_ns() < self._due_ns:
            return False
        self._due_ns = None
        self._attempts += 1
        self._attempt_ns = self._clock.now_ns()
        self._opening = in_thread("camera opening", reopen) if self._live else completed(reopen)
        return True

    def close(self) -> None:
        """Make no more attempts; a camera that is being opened is closed as soon as it is there."""
        self._reopen = self._due_ns = None
        opening, self._opening = self._opening, None
        if opening is not None:
            opening.add_done_callback(_close)


def _close(opening: Future[Camera]) -> None:
    """Close a camera that nobody waits for any more."""
    with contextlib.suppress(*RAISED):
        call_within(CLOSING_S, opening.result().close, "camera closing")
