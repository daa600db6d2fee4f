"""Ctrl-C, SIGTERM, SIGHUP: the first ends a run in order, with all that was measured; a second at once."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

INTERRUPTED = 130
"""Exit code of Ctrl-C and of the other signals that end a program in order."""


@contextmanager
def quiet_imports() -> Iterator[None]:
    """Let a signal end the program at once, in one line: nothing was begun yet.

    Libraries report a KeyboardInterrupt in the middle of their import; where one is making a class, Python
    ends by the signal in the end, whatever exit code is wanted.
    """

    def leave(*_: object) -> None:
        with suppress(OSError):  # the terminal may be gone
            os.write(2, b"interrupted\n")
        os._exit(INTERRUPTED)

    with _handled(leave):
        yield


@contextmanager
def _handled(handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Have the signals handled, except ignored ones; those from before are back in place at the end.

    Python takes signals in the main thread alone: nothing in others.
    """
    main = threading.current_thread() is threading.main_thread()
    wanted = [number for number in _SIGNALS if main and signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handle) for number in wanted}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def leave_quickly() -> None:
    """Let the interpreter end without a last garbage collection, which takes 0.3 s."""
    atexit.register(gc.freeze)


def accept_ctrl_c() -> None:
    """Let SIGINT end the program also where a script started it in the background, with SIGINT ignored."""
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        and threading.current_thread() is threading.main_thread()
    ):
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def stopped_by_signals(stop: Callable[[], None] | None = None) -> Iterator[None]:
    """Call `stop` at the first signal, which must not take long; raise KeyboardInterrupt at the next.

    Without `stop`, KeyboardInterrupt at the first: SIGTERM ends the program in order, as Ctrl-C does, and so
    does SIGHUP unless it is ignored (`nohup`). What is written to a terminal that hung up is lost.

    The handlers from before are back in place at the end.
    """
    asked = False
    terminals = [handle for handle in (1, 2) if os.isatty(handle)]

    def handle(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        nonlocal asked
        if number == signal.SIGHUP:
            _write_nowhere(terminals)
        if asked or stop is None:
            raise KeyboardInterrupt
        asked = True
        stop()

    with _handled(handle):
        yield


def _write_nowhere(handles: list[int]) -> None:
    """Let what is written there go nowhere: a terminal that is gone refuses it."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for handle in handles:
        os.dup2(nowhere, handle)
    os.close(nowhere)
