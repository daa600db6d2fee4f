"""Single keys from the terminal during a run: without Enter, and the terminal is always restored."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from typing import Any, TextIO

from zeromethod.loop.loop import Loop

HELP = "p pause  z zero  q stop"


def act(key: str, loop: Loop) -> None:
    """Act on a key: p pause or resume, z re-zero, q stop; others nothing."""
    match key.lower():
        case "p":
            loop.pause(not loop.paused)
        case "z":
            loop.rezero()
        case "q":
            loop.stop()


class Keys:
    """Keys pressed since the last call. Without a terminal in the foreground there are none.

    A context: within it the terminal passes on every key at once, without echo (cbreak mode; Ctrl-C works as
    ever), and is restored at the end.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        """stream: where keys come from; None: standard input."""
        self._stream = sys.stdin if stream is None else stream
        self._fd: int | None = None
        self._before: list[Any] = []

    @property
    def active(self) -> bool:
        """Whether keys are read."""
        return self._fd is not None

    def __enter__(self) -> Keys:
        fd = self._foreground()
        if fd is not None:
            self._before = termios.tcgetattr(fd)
            self._fd = fd
            tty.setcbreak(fd, termios.TCSADRAIN)
        return self

    def __exit__(self, *_: object) -> None:
        fd, self._fd = self._fd, None
        if fd is not None and self._foreground() is not None:
            # keys that were not read are not left to the shell
            termios.tcsetattr(fd, termios.TCSAFLUSH, self._before)

    def pressed(self) -> str:
        """Keys since the last call, oldest first; does not wait."""
        if self._fd is None or self._foreground() is None:
            return ""
        ready, _, _ = select.select([self._fd], [], [], 0)
        if not ready:
            return ""
        try:
            typed = os.read(self._fd, 64)
        except OSError:
            typed = b""
        if not typed:  # the terminal is gone
            self._fd = None
        return typed.decode("ascii", "ignore")

    def for_loop(self, loop: Loop) -> Callable[[], None]:
        """What `Loop.on_wait` is to call."""

        def on_wait() -> None:
            for key in self.pressed():
                act(key, loop)

        return on_wait

    def _foreground(self) -> int | None:
        """File descriptor of the terminal, if this program is in its foreground."""
        try:
            fd = self._stream.fileno()
            # a program in the background that touches the terminal is stopped by it
            return fd if os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp() else None
        except (OSError, ValueError, AttributeError):
            return None
