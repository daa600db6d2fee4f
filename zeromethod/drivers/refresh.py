"""The refreshes of a screen, or of a clock that takes their place, and which of them were missed."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from zeromethod.arrays import Ints
from zeromethod.clock import Clock

LATE = 1.2
"""Periods between two presentations beyond which a refresh counts as missed."""


_ROW = 12
"""Consecutive swaps that are judged: a driver may take in four at once after a stall."""


class Refreshes:
    """The refreshes of a screen. `begin` a picture, `wait` before its swap, `end` it after.

    A screen whose swaps take less than half a period does not make them wait: they are paced by the clock,
    each begun so early that it ends at a multiple of the period from the last trial on. Where the trials were
    slow for another reason, the first pictures that come too fast turn pacing on.
    """

    def __init__(self, clock: Clock, refresh_hz: float) -> None:
        """refresh_hz: nominal rate, Hz, also of the clock's refreshes."""
        self._clock = clock
        self._period_ns = 1e9 / refresh_hz
        self._origin_ns = self._last_ns = clock.now_ns()
        self._swap_ns = 0.0
        self._number = 0
        self._asked_ns = 0
        self._latest_ns: deque[int] = deque(maxlen=_ROW)
        self.paced = False
        self.dropped = 0

    def judge(self, swaps_ns: list[tuple[int, int]]) -> None:
        """Decide on pacing by trial swaps, each (before, after), ns, without those a driver only queued.

        To be called with another trial as long as `paced` is False: a busy machine makes any swap slow, but a
        screen that makes swaps wait never takes a row of them in less than half a period each.
        """
        begins, ends = np.array(swaps_ns).T
        self.paced = self._too_fast_to_block(ends)
        self._swap_ns = float(np.median(ends - begins))
        self._origin_ns = self._last_ns = int(ends[-1])

    def begin(self) -> None:
        """A picture is asked for."""
        self._asked_ns = self._clock.now_ns()

    def wait(self) -> None:
        """Where swaps are paced: return when the next one has to begin."""
        if self.paced:
            earliest = (self._clock.now_ns() + self._swap_ns - self._origin_ns) / self._period_ns
            self._number = max(self._number, math.floor(earliest)) + 1
            self._clock.sleep_until_ns(
                self._origin_ns + math.ceil(self._number * self._period_ns - self._swap_ns)
            )

    def end(self) -> int:
        """The swap is done: its time, ns.

        Refreshes are missed when the picture was asked for within a period of the one before and yet came
        more than 1.2 periods after it; those at which nothing was asked for do not count.
        """
        now_ns = self._clock.now_ns()
        since, asked_after = now_ns - self._last_ns, self._asked_ns - self._last_ns
        if asked_after < self._period_ns and since > LATE * self._period_ns:
            self.dropped += max(1, round(since / self._period_ns) - 1)
        self._last_ns = now_ns
        if not self.paced:
            self._latest_ns.append(now_ns)
            full = len(self._latest_ns) == self._latest_ns.maxlen
            self.paced = full and self._too_fast_to_block(np.array(self._latest_ns))
        return now_ns

    def _too_fast_to_block(self, ends_ns: Ints) -> bool:
        return float(np.mean(np.diff(ends_ns))) < 0.5 * self._period_ns
