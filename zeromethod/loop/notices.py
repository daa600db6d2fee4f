"""What the operator is told in words: once when it begins, not in every frame."""

from __future__ import annotations

from zeromethod.loop.events import Event

QUIET_TURNS = 120
"""Turns without an event after which it is told anew."""

TOLD = frozenset(
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
"""Events that are told in the words of their turn; others bring words of their own, or need none."""


class Notices:
    """Gathers the words of one turn."""

    def __init__(self) -> None:
        self._turn = 0
        self._last: dict[tuple[Event, str], int] = {}
        self._words: list[str] = []

    def say(self, words: str) -> None:
        """Tell in this turn."""
        self._words.append(words)

    def tell(self, event: Event, words: str) -> None:
        """Tell if `event` begins; display warnings are told apart by their words."""
        key = event, words if event is Event.DISPLAY_WARNING else ""
        if self._turn - self._last.get(key, -QUIET_TURNS) >= QUIET_TURNS:
            self._words.append(words)
        self._last[key] = self._turn

    def tell_all(self, events: tuple[Event, ...], words: str) -> None:
        """Tell those events that have no words but those of their turn."""
        for event in events:
            if event in TOLD:
                self.tell(event, words)

    def take(self) -> tuple[str, ...]:
        """All that is to be told in this turn, which it ends."""
        words, self._words = self._words, []
        self._turn += 1
        return tuple(words)
