"""A projector as a window that fills a monitor of this computer."""

from __future__ import annotations

from contextlib import nullcontext

import cv2
import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.devices.protocols import DisplayLost
from zeromethod.drivers.monitors import by_index, monitors
from zeromethod.drivers.window import WindowDisplay
from zeromethod.worker import Worker

_CLOSING_S = 0.5


class ProjectorWindow:
    """Pictures on a monitor, scaled to it where it has another size; drawn in a thread of their own.

    To be opened, polled and closed in the main thread. A window that is lost is no end of a run: `trouble`
    says so.
    """

    def __init__(self, index: int, refresh_hz: float) -> None:
        """Raises InputError, one line, without that monitor or a screen."""
        found = by_index(monitors(), index, "projector.monitor")
        self._size = found.columns, found.rows
        self._window = WindowDisplay(*self._size, found.refresh_hz or refresh_hz, index)
        self._worker: Worker[Bytes, int] = Worker("project", lambda: nullcontext(self._show), kept=1)
        self.trouble = ""
        """Why nothing is projected any more; "" while something is."""

    def show(self, picture: Bytes) -> None:
        """Show grey codes (rows, cols); a picture that still waits is left out."""
        if not self.trouble:
            self._worker.post(picture)

    def poll(self) -> None:
        """Look at the window's events."""
        if self.trouble:
            return
        try:
            self._worker.raise_failure()
            self._window.poll()
        except DisplayLost as error:
            self.trouble = f"projector: nothing is projected any more: {error}"

    def close(self) -> None:
        """Close the window; safe to call twice."""
        self._worker.close(_CLOSING_S)
        self._window.close()

    def _show(self, picture: Bytes) -> int:
        if picture.shape[::-1] != self._size:
            picture = np.asarray(cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        return self._window.show(picture)
