"""What is compiled on first use, said in words: on a new machine it takes most of the first start."""

from __future__ import annotations

import time
from collections.abc import Callable

from numba.core.event import Event, Listener, register

EVERY_S = 1.0
"""Least time between two lines."""


class _Reported(Listener):
    """Counts what is compiled, and says so every now and then."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._functions = 0
        self._said_s = float("-inf")

    def on_start(self, event: Event) -> None:
        """Say what is compiled now; those that others call are compiled on the way, and counted too."""
        where = str(event.data["dispatcher"].py_func.__module__).split(".")
        if where[0] != "zeromethod":
            return
        self._functions += 1
        if time.monotonic() - self._said_s >= EVERY_S:
            so_far = "" if self._functions == 1 else f", {self._functions} functions so far"
            self._say(f"compiling, once on a new machine: {where[1].replace('_', ' ')}{so_far}")
            self._said_s = time.monotonic()

    def on_end(self, event: Event) -> None:
        """Say nothing."""


_reported: list[_Reported] = []


def report_compiling(say: Callable[[str], None]) -> None:
    """Pass on a line now and then whenever something is compiled in this process; the first call counts."""
    if not _reported:
        _reported.append(_Reported(say))
        register("numba:compile", _reported[0])  # type: ignore[no-untyped-call]
