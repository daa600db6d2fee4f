"""Noticing that the host slept or the program stood still: what was waited for in the meantime is stale."""

from __future__ import annotations

import time

STOOD_STILL_S = 1.5
"""A turn of the loop, beyond what it may wait for a frame, that is no turn."""

SUSPENDED_S = 0.1
"""Time beyond the monotonic clock's by which the host must have slept."""


def slept_ns() -> int:
    """Time that the host has been suspended since it was started, ns; 0 where it does not tell."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()


class ClockWatch:
    """To be asked once per turn, in real time only."""

    def __init__(self, longest_wait_s: float) -> None:
        """longest_wait_s: how long a turn may wait for a frame."""
        self._longest_s = longest_wait_s + STOOD_STILL_S
        self._last_ns: int | None = None
        self._slept_ns = slept_ns()

    def restart(self) -> None:
        """Start counting from now."""
        self._last_ns = None
        self._slept_ns = slept_ns()

    def look(self, now_ns: int) -> str:
        """What happened to time since the last call, in words; "" for nothing. now_ns: the run's clock."""
        slept, self._slept_ns = slept_ns() - self._slept_ns, slept_ns()
        last_ns, self._last_ns = self._last_ns, now_ns
        if slept > 1e9 * SUSPENDED_S:
            return f"the host was suspended for {1e-9 * slept:.1f} s"
        if last_ns is not None and now_ns - last_ns > 1e9 * self._longest_s:
            return f"the program stood still for {1e-9 * (now_ns - last_ns):.1f} s"
        return ""
