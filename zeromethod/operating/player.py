"""Playing a recording: which moment is shown, as time goes on, is scrubbed, or goes round a stretch."""

from __future__ import annotations

import time
from collections.abc import Callable

from zeromethod.errors import InputError
from zeromethod.operating.controls import Controls, Perform
from zeromethod.operating.replay_table import REPLAY

SHORTEST_S = 0.05
"""Length of the shortest stretch."""


class Player:
    """Where in a recording of `duration_s` one is. Used in one thread; calls come by `controls`."""

    def __init__(
        self, duration_s: float, speed: float = 1.0, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.duration_s, self.speed = duration_s, speed
        self.from_s, self.to_s = 0.0, duration_s
        self.playing, self.closed = True, False
        self._now_s = now_s
        self._at_s, self._since_s = 0.0, now_s()
        perform: dict[str, Perform] = {
            "play": self._play,
            "pause": self._pause,
            "seek": self._seek,
            "speed": self._speed,
            "stretch": self._stretch,
            "close": self._close,
        }
        self.controls = Controls(REPLAY, perform)

    def at_s(self) -> float:
        """Moment that is shown now, s from the recording's first step."""
        now_s = self._now_s()
        if self.playing:
            self._at_s += self.speed * (now_s - self._since_s)
        self._since_s = now_s
        if self.playing and self._at_s > self.to_s:
            length_s = self.to_s - self.from_s
            whole = self.from_s <= 0.0 and self.to_s >= self.duration_s
            if whole or length_s <= 0.0:
                self._at_s, self.playing = self.to_s, False  # the end
            else:
                self._at_s = self.from_s + (self._at_s - self.from_s) % length_s
        return self._at_s

    def _play(self) -> None:
        self.at_s()
        if self._at_s >= self.to_s:
            self._at_s = self.from_s
        self.playing = True

    def _pause(self) -> None:
        self.at_s()
        self.playing = False

    def _seek(self, time_s: float) -> None:
        self.at_s()
        self._at_s = min(time_s, self.duration_s)

    def _speed(self, value: float) -> None:
        self.at_s()
        self.speed = value

    def _stretch(self, from_s: float, to_s: float) -> None:
        to_s = min(to_s, self.duration_s)
        if to_s - from_s < min(SHORTEST_S, self.duration_s):
            raise InputError(f"stretch: {from_s:g} to {to_s:g} s: at least {SHORTEST_S:g} s of the recording")
        self.at_s()
        self.from_s, self.to_s = from_s, to_s
        if not from_s <= self._at_s <= to_s:
            self._at_s = from_s

    def _close(self) -> None:
        self.closed = True
