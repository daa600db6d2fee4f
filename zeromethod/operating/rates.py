"""How often something happens: counted over the last two seconds of the run's clock."""

from __future__ import annotations

from collections import deque

WINDOW_S = 2.0


class Rate:
    """Events per second of the run's clock."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque()

    def note(self, time_s: float) -> None:
        """One more, at this time."""
        self._times_s.append(time_s)
        while self._times_s[0] < time_s - WINDOW_S:
            self._times_s.popleft()

    def at(self, now_s: float) -> float | None:
        """Per second, up to `now_s`; None before there were three."""
        while self._times_s and self._times_s[0] < now_s - WINDOW_S:
            self._times_s.popleft()
        if len(self._times_s) < 3:
            return None
        # from the first of them on; to now, where the next one is overdue
        length_s = self._times_s[-1] - self._times_s[0]
        each_s = length_s / (len(self._times_s) - 1)
        late_s = max(now_s - self._times_s[-1] - each_s, 0.0)
        whole_s = length_s + late_s
        return (len(self._times_s) - 1) / whole_s if whole_s > 0 else None
