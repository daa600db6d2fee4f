"""Words that are said again and again while something takes long, so that nobody takes it for hung."""

from __future__ import annotations

import threading
from collections.abc import Callable

EVERY_S = 1.5
"""Time between two lines."""


class StillBusy:
    """Says every `EVERY_S` what is being done, from a thread of its own; nothing is, to begin with."""

    def __init__(self, say: Callable[[str], None]) -> None:
        """say: is given the words, in that thread."""
        self._say = say
        self._words = ""
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def doing(self, words: str) -> None:
        """What is being done from now on; "" for nothing. First said after `EVERY_S`."""
        self._words = words
        if words and self._thread is None:
            self._thread = threading.Thread(target=self._run, name="still busy", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Say nothing any more."""
        self._words = ""
        self._closed.set()

    def _run(self) -> None:
        said, since_s = "", 0.0
        while not self._closed.wait(EVERY_S):
            words = self._words
            if words:
                # the same words again say how long it has been
                since_s = since_s + EVERY_S if words == said else 0.0
                self._say(f"{words} ({since_s:.0f} s)" if since_s else words)
            said = words
