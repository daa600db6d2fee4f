"""The one clock of a run: nanoseconds, either the host's monotonic time or simulated time.

Simulated time stands still while the software computes and moves only when a simulated device
is waited for, so a test of latency is exact and as fast as the machine allows.
"""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """Where a run takes its time from. All times in ns."""

    def now_ns(self) -> int:
        """Present time, ns; never decreases."""

    def sleep_until_ns(self, time_ns: int) -> None:
        """Return once `now_ns() >= time_ns` (at once when that has passed)."""


class HostClock:
    """The host's monotonic clock."""

    def now_ns(self) -> int:
        """Monotonic host time, ns."""
        return time.monotonic_ns()

    def sleep_until_ns(self, time_ns: int) -> None:
        """Sleep until the host's clock reads `time_ns`."""
        while (left := time_ns - time.monotonic_ns()) > 0:
            time.sleep(left * 1e-9)


class SimulatedClock:
    """Time that moves only by `sleep_until_ns`; starts at `start_ns`."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Simulated time, ns."""
        return self._now_ns

    def sleep_until_ns(self, time_ns: int) -> None:
        """Move simulated time forward to `time_ns`."""
        self._now_ns = max(self._now_ns, time_ns)
