"""How a calibration tells the person at the bench what it does and what to do."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Teller(Protocol):
    """Anything that shows progress and passes words on."""

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:
        """Begin a part of `total` steps; what it gives is called after each."""

    def say(self, words: str) -> None:
        """Pass on one line: what to do now, or what was found."""


class Silence:
    """Tells nobody."""

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:  # noqa: ARG002
        """Count nothing."""
        return nullcontext(lambda: None)

    def say(self, words: str) -> None:
        """Say nothing."""
