"""Notices for the operator: each is shown when it begins, not in every frame."""

from __future__ import annotations

from collections.abc import Iterable

from zeromethod.loop.events import Event, Notice

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
