"""Levels out, readings in; copes with arrays that fall silent, start again or are lost."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any

from zeromethod.light_array.devices import ArraysLost, Counts, LightArrays, Readings
from zeromethod.light_array.frames import NUMBERS
from zeromethod.loop.state import State

_REMEMBERED = 256
"""So many of the newest levels sent are remembered: readings may still show them."""

_RESTARTED = 20
"""After so many consecutive readings with numbers not above the last, the arrays have started again."""

_TIMEOUT_S, _RETRY_S = 0.1, 0.2
"""How long each wait for readings takes; pause between attempts to open lost arrays."""

Record = Callable[..., None]
"""Takes rows for a recording: the name of its table ("readings", "levels", "depth"), then the columns."""


def no_record(*_row: Any) -> None:
    """Record nothing."""


class GivenUp(Exception):
    """The arrays cannot be reached any more, or the run was stopped; `Exchange.trouble` says why."""


class Exchange:
    """Sends levels to the arrays and takes their readings, in order.

    counts: events so far, by name. trouble: state and reason while readings are missing, else None. last:
    the newest readings. shift_ns: by how much the arrays' clock jumped when they started again. notes: for
    the operator, in the next step. stopped: set to end the run.
    """

    def __init__(self, arrays: LightArrays, reopen_s: float, record: Record) -> None:
        self.arrays, self.record = arrays, record
        self.counts: Counter[str] = Counter()
        self.trouble: tuple[State, str] | None = None
        self.last: Readings | None = None
        self.shift_ns = 0
        self.notes: tuple[str, ...] = ()
        self.stopped = False
        self._reopen_s = reopen_s
        self._sent: deque[tuple[int, Counts]] = deque(maxlen=_REMEMBERED)
        self._number = self._backwards = 0
        self._silent_s = 0.0

    def newest_levels(self) -> Counts:
        """Levels that were sent last."""
        return self._sent[-1][1]

    def levels(self, number: int) -> Counts | None:
        """Levels that were sent under a number; None where none were, or too long ago."""
        return next((levels for sent, levels in reversed(self._sent) if sent == number), None)

    def send(self, levels: Counts) -> None:
        """Send levels. Raises GivenUp where the arrays are lost and cannot be opened again."""
        self._number = (self._number + 1) & NUMBERS  # as readings return it
        self._sent.append((self._number, levels))
        self.record("levels", self._number, levels)
        try:
            self.arrays.send(self._number, levels)
        except ArraysLost as error:
            self._lost(str(error))

    def measure(self, wanted: Sequence[Counts]) -> list[Readings | None]:
        """Have levels lit, one after the other; return the readings of each, None where they were lost.

        Raises GivenUp where none come at all.
        """
        first = self._number + 1
        found: list[Readings | None] = [None] * len(wanted)
        for k in range(len(wanted) + _REMEMBERED // 4):
            self.send(wanted[min(k, len(wanted) - 1)])
            got = self._wait()
            if 0 <= got.shown - first < len(wanted):
                found[got.shown - first] = got
            if found[-1] is not None and k >= len(wanted) - 1:
                break
        return found

    def _wait(self) -> Readings:
        for _ in range(max(round(self._reopen_s / _TIMEOUT_S), 1)):
            got = self.next()
            if self.stopped:
                raise GivenUp
            if got is not None:
                return got
            if self.trouble and self.trouble[0] is State.FAULT:
                raise GivenUp
        self.trouble = State.FAULT, self.trouble[1] if self.trouble else "the arrays send no readings"
        raise GivenUp

    def next(self) -> Readings | None:
        """Return the next readings; None for late ones, or where none came in time. Raises GivenUp."""
        try:
            got = self.arrays.receive(_TIMEOUT_S)
            if got is None:
                self._silent()
        except ArraysLost as error:
            self._lost(str(error))
            return None
        if self.arrays.broken:
            self.counts["frames broken on the way"] = self.arrays.broken
        if got is None:
            return None
        self.record("readings", got.number, got.shown, got.time_ns, got.counts)
        self._silent_s, self.trouble = 0.0, None
        last = self.last
        if last is not None and got.number <= last.number:
            self._backwards += 1
            if self._backwards < _RESTARTED:
                return None
            self._restarted(got, last)
        elif last is not None:
            late = {"readings out of order": self._backwards, "readings lost": got.number - last.number - 1}
            self.counts.update({name: count for name, count in late.items() if count})
        self._backwards = 0
        self.last = got
        return got

    def _silent(self) -> None:
        """Note how long nothing came; send the newest levels again."""
        self.counts["times without readings"] += not self._silent_s
        silent_s = self._silent_s = self._silent_s + _TIMEOUT_S
        self.trouble = State.HOLDING, f"no readings for {silent_s:.1f} s: power, cable, address"
        if silent_s >= self._reopen_s:
            self.trouble = State.FAULT, f"the arrays sent nothing for {silent_s:.1f} s"
        elif self._sent:  # arrays that were off do not know whom to send readings to
            self.arrays.send(*self._sent[-1])

    def _restarted(self, got: Readings, last: Readings) -> None:
        """Go on with arrays that count from 0 again, and whose clock may do so, too."""
        self.counts.update({"arrays started again": 1, "readings lost": self._backwards - 1})
        self.notes += ("the arrays started again: readings go on by what was measured before",)
        self.shift_ns += got.time_ns - last.time_ns

    def _lost(self, why: str) -> None:
        """Try to open lost arrays again, for as long as the rig says."""
        self.counts["arrays lost"] += 1
        until = time.monotonic() + self._reopen_s
        while not self.arrays.reopen():
            if time.monotonic() >= until or self.stopped:
                self.trouble = State.FAULT, f"the arrays are lost: {why}"
                raise GivenUp
            time.sleep(_RETRY_S)
        self.trouble = State.HOLDING, f"the arrays were lost and are open again: {why}"
