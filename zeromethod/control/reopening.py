"""Opening a lost camera again, a bounded number of times."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from zeromethod.clock import Clock
from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout
from zeromethod.errors import InputError

PER_MINUTE = 3
WAITS_S = (0.5, 2.0, 8.0)
"""Pause before the first, second and third attempt within a minute: a bus needs time to come back."""


class Reopener:
    """At most three attempts in any minute, further apart each time."""

    def __init__(self, reopen: Callable[[], Camera] | None, clock: Clock) -> None:
        self._reopen = reopen
        self._clock = clock
        self._attempts_ns: deque[int] = deque(maxlen=PER_MINUTE)

    @property
    def exhausted(self) -> bool:
        """Whether no further attempt is allowed now."""
        return self._reopen is None or self._recent() >= PER_MINUTE

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
        except (CameraLost, CameraTimeout, InputError):
            return None
