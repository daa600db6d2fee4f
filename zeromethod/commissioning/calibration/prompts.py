"""What a calibration says to the person at the bench: what it does now, and what to do."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Prompts(Protocol):
    """Anything that shows progress and passes lines on to a person."""

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:
        """Begin a part of `total` steps; what it gives is called after each."""

    def say(self, words: str) -> None:
        """Pass on one line: what to do now, or what was found."""


class Silent:
    """Prompts that nobody gets."""

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:  # noqa: ARG002
        """Count nothing."""
        return nullcontext(lambda: None)

    def say(self, words: str) -> None:
        """Say nothing."""
