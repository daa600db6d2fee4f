"""A progress bar for whatever takes longer than a second; a line now and then where there is no terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

EVERY_S = 10.0
"""Least time between two lines where there is no terminal."""


class PlainLines:
    """Lines that say how far something is where there is no terminal, the first after `EVERY_S`."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._next_s = time.monotonic() + EVERY_S

    def say(self, words: Callable[[], str]) -> None:
        """Say the words if it is time."""
        if not self._console.is_terminal and time.monotonic() >= self._next_s:
            self._console.print(words(), markup=False, highlight=False, soft_wrap=True)
            self._next_s = time.monotonic() + EVERY_S


class Advance(Protocol):
    """Called after each finished step."""

    def __call__(self, following: str = ..., /) -> None:
        """Name the next step; "" at the end, the same name as before without."""


@contextmanager
def progress(total: int, first: str = "") -> Iterator[Advance]:
    """Bar over `total` steps on the terminal; `first` names the step that begins now."""
    console = Console(stderr=True)
    bar = Progress(
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    task = bar.add_task(first, total=total)
    lines = PlainLines(console)

    def advance(following: str = first, /) -> None:
        bar.update(task, advance=1, description=following)
        lines.say(lambda: f"{following or first}: {bar.tasks[0].completed:.0f} of {total}")

    with bar:
        yield advance
