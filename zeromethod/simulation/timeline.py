"""Times of a simulated device's events: a seeded, jittering clock for each device.

Event k happens at (phase + k) / rate plus a jitter that depends on seed, stream and k alone, so any event
can be asked for in any order and is the same in every run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_WORD = 2**64 - 1
JITTER_LIMIT = 0.4
"""Jitter is clipped to this share of a period, so that events keep their order."""


def counter_normal(seed: int, stream: int, index: int) -> float:
    """Return standard normal number `index` of a stream, a function of these arguments alone."""
    key = np.array([seed & _WORD, stream], dtype=np.uint64)
    counter = np.array([0, index & _WORD, 0, 0], dtype=np.uint64)
    words = np.random.Philox(key=key, counter=counter)
    return float(np.random.Generator(words).standard_normal())


@dataclass(frozen=True, slots=True)
class Timeline:
    """Events at `rate_hz`; event 0 is `phase` periods after time 0; `jitter_s` is the jitter's sigma."""

    rate_hz: float
    phase: float = 0.0
    jitter_s: float = 0.0
    seed: int = 0
    stream: int = 0

    def time_ns(self, index: int) -> int:
        """Time of event `index` (any integer), ns; rises with it."""
        time_s = (self.phase + index) / self.rate_hz
        if self.jitter_s > 0:
            limit = JITTER_LIMIT / self.rate_hz
            jitter_s = self.jitter_s * counter_normal(self.seed, self.stream, index)
            time_s += min(max(jitter_s, -limit), limit)
        return round(time_s * 1e9)

    def first_after(self, time_ns: int) -> int:
        """Index of the first event strictly after `time_ns`."""
        index = math.floor(time_ns * 1e-9 * self.rate_hz - self.phase) - 1
        while self.time_ns(index) <= time_ns:
            index += 1
        return index

    def last_until(self, time_ns: int) -> int:
        """Index of the last event at or before `time_ns`."""
        return self.first_after(time_ns) - 1
