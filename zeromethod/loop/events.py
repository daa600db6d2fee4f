"""What can happen to a frame or a device: the event that code branches on, and its words for a person.

A notice is shown to the operator when its event begins, not in every frame.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass


class Event(enum.StrEnum):
    """One thing that happened in a step of the loop, under the name that logs and summaries show."""

    FRAMES_DROPPED = "frames dropped"
    FRAME_REPEATED = "repeated frame"
    FRAME_LATE = "late frame"
    FRAME_TORN = "torn frame"
    FRAME_DISORDERED = "frame out of order"
    FRAME_WRONG = "wrong frame"
    CLOCK_JUMPED = "clock jumped"
    LIGHT_OFF = "light off"
    SATURATED = "saturated"
    FLICKER = "light flickers"
    NOT_LIT = "picture not lit yet"
    STRIPS_CONTRADICT = "strips contradict the log"
    PICTURES_MIXED = "pictures mixed"
    FROZEN = "frozen by request"
    ZERO_TAKEN = "zero taken"
    ZERO_REFUSED = "zero refused"
    BENCH_MOVED = "bench moved"
    BENCH_FOLLOWED = "bench followed"
    MARK_FAINT = "mark too faint"
    CAMERA_TIMEOUT = "camera timeout"
    CAMERA_STALLED = "camera stalled"
    CAMERA_LOST = "camera lost"
    CAMERA_REOPENED = "camera reopened"
    DISPLAY_ASLEEP = "display asleep"
    DISPLAY_WARNING = "display warning"
    DISPLAY_LOST = "display lost"
    DEVICE_BROKEN = "device driver failed"
    BURST = "coded pictures"


REFUSAL_WORDS = {
    Event.STRIPS_CONTRADICT: "the coded strips contradict what was shown",
    Event.NOT_LIT: "the picture was not lit yet",
    Event.LIGHT_OFF: "the light is off",
    Event.FROZEN: "frozen by request",
    Event.PICTURES_MIXED: "two different pictures in one exposure",
    Event.DISPLAY_ASLEEP: "the LCD is asleep",
}
"""Why a frame brought no new command, for events that need no further detail."""

QUIET_STEPS = 120
"""Steps without an event after which it is shown again."""

SHOWN_IN_WORDS_OF_STEP = frozenset(
    {
        Event.FRAME_WRONG,
        Event.CLOCK_JUMPED,
        Event.LIGHT_OFF,
        Event.CAMERA_TIMEOUT,
        Event.CAMERA_STALLED,
        Event.CAMERA_LOST,
        Event.CAMERA_REOPENED,
    }
)
"""Events that are shown in the words of their step; others bring words of their own, or need none."""


@dataclass(frozen=True, slots=True)
class Notice:
    """An event with its words for the operator: one line, without a full stop."""

    event: Event
    words: str

    @classmethod
    def refusal(cls, event: Event) -> Notice:
        """Notice in the words of `REFUSAL_WORDS`."""
        return cls(event, REFUSAL_WORDS[event])


class Notices:
    """Gathers the notices of one step."""

    def __init__(self) -> None:
        self._step = 0
        self._last: dict[tuple[Event, str], int] = {}
        self._words: list[str] = []

    def add(self, notice: Notice) -> None:
        """Show a notice if its event begins; display warnings count as different events by their words."""
        key = notice.event, notice.words if notice.event is Event.DISPLAY_WARNING else ""
        if self._step - self._last.get(key, -QUIET_STEPS) >= QUIET_STEPS:
            self._words.append(notice.words)
        self._last[key] = self._step

    def add_always(self, notice: Notice) -> None:
        """Show a notice in this step, whether or not its event was there before."""
        self._words.append(notice.words)

    def add_events(self, events: Iterable[Event], words: str) -> None:
        """Show those events whose words are those of their step."""
        for event in events:
            if event in SHOWN_IN_WORDS_OF_STEP:
                self.add(Notice(event, words))

    def take(self) -> tuple[str, ...]:
        """All words of this step, which it ends."""
        words, self._words = self._words, []
        self._step += 1
        return tuple(words)
