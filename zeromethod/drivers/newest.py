"""A place for one frame between the thread that grabs and the loop that reads: the newest, never a queue."""

from __future__ import annotations

import threading
from dataclasses import replace

from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame


class Newest:
    """Holds the newest frame that was not yet taken; what it replaces is counted as dropped."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: Frame | None = None
        self._dropped = 0
        self._ended: str | None = None

    def put(self, frame: Frame) -> None:
        """Give a frame; its own `dropped` (lost on the way here) adds to the count. Never waits."""
        with self._changed:
            self._dropped += frame.dropped + (self._frame is not None)
            self._frame = frame
            self._changed.notify()

    def end(self, reason: str) -> None:
        """Say that no frame will come any more; the first reason stays."""
        with self._changed:
            if self._ended is None:
                self._ended = reason
            self._changed.notify_all()

    def take(self, timeout_s: float) -> Frame:
        """Newest frame not yet taken, with all that were dropped since the one taken before.

        Waits up to `timeout_s`, then raises CameraTimeout. Raises CameraLost with the reason once it has
        ended and nothing is left.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None or self._ended is not None, timeout_s)
            if self._frame is None:
                if self._ended is not None:
                    raise CameraLost(self._ended)
                raise CameraTimeout(f"no frame within {timeout_s:g} s")
            frame = replace(self._frame, dropped=self._dropped)
            self._frame, self._dropped = None, 0
            return frame
