"""Single keys from the terminal during a run: without Enter, and the terminal is always restored."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from typing import Any, TextIO

from zeromethod.operating.controls import Controls
from zeromethod.session.session import Session

HELP = "p pause  z zero  r record  s snapshot  m mark  q stop"


def act(key: str, controls: Controls, paused: bool, recording: bool) -> None:
    """Call the method of a key, of those that need no argument; other keys do nothing.

    Of two methods with one key the one that makes sense: pause or resume, record or end the recording.
    """
    methods = {
        "p": "resume" if paused else "pause",
        "z": "zero",
        "r": "stop_recording" if recording else "record",
        "s": "snapshot",
        "m": "mark",
        "q": "stop",
    }
    if method := methods.get(key.lower()):
        controls.call(method, source="terminal")


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

    def for_session(self, session: Session, controls: Controls) -> Callable[[], None]:
        """What `Loop.on_wait` is to call: it carries out keys, and whatever else was called."""

        def on_wait() -> None:
            for key in self.pressed():
                act(key, controls, session.loop.paused, session.recording.running)
            controls.attend()

        return on_wait

    def _foreground(self) -> int | None:
        """File descriptor of the terminal, if this program is in its foreground."""
        try:
            fd = self._stream.fileno()
            # a program in the background that touches the terminal is stopped by it
            return fd if os.isatty(fd) and os.tcgetpgrp(fd) == os.getpgrp() else None
        except (OSError, ValueError, AttributeError):
            return None
