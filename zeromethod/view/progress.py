"""A progress bar for whatever takes longer than a second; silent when not on a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


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

    def advance(following: str = first, /) -> None:
        bar.update(task, advance=1, description=following)

    with bar:
        yield advance
