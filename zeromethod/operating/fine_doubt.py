"""Whether the fine surface that is shown counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from zeromethod.loop.state import State

FINE_LATE_S = 2.0
"""Age from which a fine surface counts as held: one comes about twice a second, within a second."""

FRAMES_S = 1.5
"""How much older than a fine surface's newest frame the oldest of its frames may be."""

_SPOILING = frozenset({State.MOVED, State.COVERED, State.LOST, State.FAULT})
"""States of which no frame may be read together with later ones."""


@dataclass(frozen=True, slots=True)
class Spoiled:
    """Up to which time, s of the run, fine surfaces do not count, and why."""

    until_s: float = -math.inf
    why: str = ""
    last_s: float = -math.inf

    def seen(self, state: State, time_s: float, new_zero: bool) -> Spoiled:
        """The same after a step. new_zero: its warp starts from another zero than that of the step before."""
        if state in _SPOILING:
            return Spoiled(time_s + FRAMES_S, f"held: some of its frames may be of the state {state}", time_s)
        if new_zero and self.last_s > self.until_s:
            return Spoiled(self.last_s, "held: read from the zero before", time_s)
        return Spoiled(self.until_s, self.why, time_s)

    def doubt(self, doubt: str, fine_s: float | None, now_s: float) -> str:
        """Why the newest fine surface is not to be relied on; "" where it is, or where there is none.

        doubt: why no depth is. fine_s: time of the fine surface's newest frame. now_s: of the newest step.
        """
        if fine_s is None:
            return ""
        late_s = now_s - fine_s
        late = f"held: every pixel was read {late_s:.1f} s ago" if late_s > FINE_LATE_S else ""
        return doubt or (self.why if fine_s <= self.until_s else "") or late
