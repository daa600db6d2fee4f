"""What a start is doing, in the terminal, where there is none, and on the page."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console
from rich.status import Status

from zeromethod.page.process import PageProcess
from zeromethod.page.run_feed import starting
from zeromethod.still_busy import StillBusy


class Starting:
    """A line on the terminal, which goes once the run has begun; elsewhere lines, if it takes long."""

    def __init__(self, console: Console, page: PageProcess | None, first: str) -> None:
        """first: what is done first."""
        self._console, self._page, self._first = console, page, first
        self._status: Status | None = None
        self._busy = StillBusy(self._print)

    def __enter__(self) -> Callable[[str], None]:
        self._say(self._first)
        return self._say

    def __exit__(self, *_: object) -> None:
        self._say("")
        self._busy.close()

    def _print(self, words: str) -> None:
        self._console.print(words, highlight=False, soft_wrap=True)

    def _say(self, words: str) -> None:
        """Show what is being done now; "" for no more."""
        if self._status is not None:
            self._status.stop()
            self._status = None
        if not self._console.is_terminal:
            self._busy.doing(words and f"starting: {words}")
        if not words:
            return
        if self._page is not None:
            content = starting(words)
            self._page.offer(lambda _parts: content)
        if self._console.is_terminal:
            self._status = self._console.status(f"starting: {words}", spinner="dots")
            self._status.start()
