"""Faults that show while the frames are good: the display's window and power, the host's time."""

from __future__ import annotations

import time

from zeromethod.devices.abilities import is_asleep, poll_of, warnings_of
from zeromethod.devices.protocols import Display
from zeromethod.loop.events import Event, Notice

RESYNC_S = 0.5
"""After time stood still, frames are not used for so long: those that had been waiting come first."""

STOOD_STILL_S = 1.5
"""How long a step may take, beyond its wait for a frame, before the program counts as having stood still."""

SUSPENDED_S = 0.1
"""Growth of the suspended time from which the host counts as having slept."""


def slept_ns() -> int:
    """Time that the host has been suspended since it was started, ns."""
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


class DisplayWatch:
    """Watches a display, as far as its driver reports, and the clock, where that is the host's."""

    def __init__(self, display: Display, longest_wait_s: float | None) -> None:
        """longest_wait_s: how long the loop waits for a frame in the host's time; None in simulated time."""
        self._display = display
        self._poll = poll_of(display)
        self._asleep = False
        self._warnings: tuple[str, ...] = ()
        self._clock = None if longest_wait_s is None else ClockWatch(longest_wait_s)
        self._stale_until_ns = 0
        self._jumped: list[Notice] = []
        self._warned: set[str] = set()

    def restart(self) -> None:
        """Forget when time was last looked at: the loop was not running in between."""
        if self._clock is not None:
            self._clock.restart()

    def poll(self) -> None:
        """Let the display process its events, and read its state; raises DisplayLost, or what it raises."""
        if self._poll is not None:
            self._poll()
        self._asleep = is_asleep(self._display)
        self._warnings = warnings_of(self._display)

    def stale(self, now_ns: int) -> Notice | None:
        """Why a frame that came to hand at `now_ns` must not be used; None where it may be."""
        if self._asleep:
            return Notice.refusal(Event.DISPLAY_ASLEEP)
        self._look_at_clock(now_ns)
        if now_ns < self._stale_until_ns:
            return Notice(Event.CLOCK_JUMPED, "time stood still: waiting for fresh frames")
        return None

    def look(self, now_ns: int) -> list[Notice]:
        """Notices at the end of a step."""
        notices = [Notice.refusal(Event.DISPLAY_ASLEEP)] if self._asleep else []
        for warning in self._warnings:
            if warning not in self._warned:
                self._warned.add(warning)
                notices.append(Notice(Event.DISPLAY_WARNING, warning))
        self._look_at_clock(now_ns)
        notices += self._jumped
        self._jumped = []
        return notices

    def _look_at_clock(self, now_ns: int) -> None:
        if self._clock is not None and (jumped := self._clock.look(now_ns)):
            self._stale_until_ns = now_ns + round(1e9 * RESYNC_S)
            self._jumped.append(Notice(Event.CLOCK_JUMPED, jumped))
