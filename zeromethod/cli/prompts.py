"""Progress bars and lines on the terminal, for procedures that ask a person to do things."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from zeromethod.view.progress import progress


class TerminalPrompts:
    """Progress bars, and lines above them."""

    @contextmanager
    def part(self, words: str, total: int) -> Iterator[Callable[[], object]]:
        """A bar over `total` steps."""
        with progress(total, words) as advance:
            yield lambda: advance(words)

    def say(self, words: str) -> None:
        """A line on the terminal."""
        click.echo(words, err=True)
