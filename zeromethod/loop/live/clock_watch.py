"""Detection of a host that was suspended or a program that stood still: frames from before are stale."""

from __future__ import annotations

import time

STOOD_STILL_S = 1.5
"""How long a step may take, beyond its wait for a frame, before the program counts as having stood still."""

SUSPENDED_S = 0.1
"""Growth of the suspended time from which the host counts as having slept."""


def slept_ns() -> int:
    """Time that the host has been suspended since it was started, ns; 0 where it is not known."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()


class ClockWatch:
    """Watches the clocks of a live loop; `look` is called once per step."""

    def __init__(self, longest_wait_s: float) -> None:
        """longest_wait_s: how long a step may wait for a frame."""
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
