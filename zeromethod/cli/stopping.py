"""Ctrl-C and SIGTERM: the first ends a run in order, with all that was measured; a second one at once."""

from __future__ import annotations

import atexit
import gc
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


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

    Without `stop`, KeyboardInterrupt at the first: SIGTERM ends the program in order, as Ctrl-C does.

    The handlers from before are back in place at the end. To be used in the main thread.
    """
    asked = False

    def handle(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        nonlocal asked
        if asked or stop is None:
            raise KeyboardInterrupt
        asked = True
        stop()

    before = {number: signal.signal(number, handle) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
