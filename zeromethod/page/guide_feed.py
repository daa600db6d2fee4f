"""What setting up and calibrating give their page: the step, what to do, and the live picture."""

from __future__ import annotations

import threading
from typing import Any

from zeromethod.devices.contract import taken
from zeromethod.devices.protocols import Camera, Frame, gives_buffers
from zeromethod.operating.controls import Controls
from zeromethod.operating.table import Table
from zeromethod.page.message import Content, Said
from zeromethod.page.process import PageProcess

LINES = 12
"""Lines that stay on the page."""

LOOK_S = 0.1


class GuideFeed:
    """Hands values and the newest picture to a page, from any thread. Calls come in a thread of its own."""

    def __init__(self, page: PageProcess, table: Table, controls: Controls, bits: int) -> None:
        self._page, self._controls, self._bits = page, controls, bits
        self._lock = threading.Lock()
        self._values: dict[str, Any] = {one.name: None for one in table.values}
        self._values |= {"state": "starting", "reason": "", "advice": "", "fresh": True, "lines": []}
        self._values |= {"step_name": "", "instruction": "", "verdict": ""}
        self._frame: Frame | None = None
        self._over = threading.Event()
        page.attach(controls)
        threading.Thread(target=self._attend, name="page calls", daemon=True).start()

    def set(self, **values: Any) -> None:
        """Change values."""
        with self._lock:
            self._values = self._values | values
        self._offer()

    def say(self, words: str, time_s: float | None = None) -> None:
        """Add a line, which is what to do now unless it is a warning ("! ...")."""
        with self._lock:
            lines = [words, *self._values["lines"]][:LINES]
            self._values = self._values | {"lines": lines, "state": "working"}
            if not words.startswith("!"):
                self._values["instruction"] = words
        self._page.say(Said("note", words, time_s))
        self._offer()

    def picture(self, frame: Frame) -> None:
        """Show a picture."""
        self._frame = frame
        self._offer()

    def close(self) -> None:
        """Carry out no more calls."""
        self._over.set()
        self._controls.close()

    def _offer(self) -> None:
        values, frame, bits = self._values, self._frame, self._bits

        def compose(parts: frozenset[str]) -> Content:
            if frame is None or "camera" not in parts:
                return Content(values)
            about = {"step": frame.number, "time_s": None, "bits": bits}
            return Content(values, [], {}, {"camera": {"image": frame.image}}, {"camera": about})

        self._page.offer(compose)

    def _attend(self) -> None:
        while not self._over.wait(LOOK_S):
            self._controls.attend()


class WatchedCamera:
    """A camera whose pictures are also shown; all else is the camera's own."""

    def __init__(self, camera: Camera, feed: GuideFeed) -> None:
        self._camera, self._feed = camera, feed

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    @gives_buffers
    def read(self, timeout_s: float) -> Frame:
        """As the camera's."""
        frame = taken(self._camera.read, timeout_s)
        self._feed.picture(frame)
        return frame
