"""A camera that is grabbed in a thread of its own: reading is quick, and a hung device hangs nothing."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Protocol

from zeromethod.devices.abilities import identity_of
from zeromethod.devices.contract import RAISED, own
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame, gives_buffers
from zeromethod.errors import InputError
from zeromethod.worker import Worker, completed

ANSWER_S = 3.0
"""How long a change of the exposure may take."""

CLOSING_S = 0.5
"""How long `close` waits for the device; a hung one is left to its thread."""

POLL_S = 0.1
"""How long a source may wait for a frame before it checks whether it is to end."""


class Source(Protocol):
    """A device as the grabbing thread has it. All members are used in that thread only.

    It may also have `serial` and `model`, text, and `set_exposure` as `ExposingCamera` has it.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""

    @property
    def bits(self) -> int:
        """Significant bits per pixel."""

    @property
    def on_demand(self) -> bool:
        """Whether it exposes only when it is asked (software trigger)."""

    def grab(self) -> Frame | None:
        """Next frame; None when none came for a moment (`POLL_S`). Raises CameraLost.

        Its image is copied before the next call, unless this is marked `gives_buffers`.
        """

    def close(self) -> None:
        """Release the device."""


class GrabbedCamera:
    """A `Camera` over a `Source`, which is opened, grabbed and closed in one daemon thread.

    `read` returns the newest frame not yet returned, and what it skips counts as dropped. With a source on
    demand each `read` asks for an exposure. `close` returns within half a second: a device that hangs is
    left to its thread, which closes it as soon as it answers and does not keep the program from ending.
    """

    shape: tuple[int, int]
    """(rows, cols) of every frame."""
    bits: int
    """Significant bits per pixel: 8 to 16."""
    serial: str
    """Serial number of the device, "" where it has none."""
    model: str
    """Model of the device, "" where it has none."""

    def __init__(self, name: str, open_source: Callable[[], Source], open_timeout_s: float) -> None:
        """Open it; raises what `open_source` raises, CameraLost when that takes over `open_timeout_s`."""
        self._open_source = open_source
        self._asked = threading.Event()
        self._counted = 0
        self._returned = 0
        self._end = ""
        self._settable = False
        self._exposures: deque[tuple[float, Future[float]]] = deque()
        self._worker: Worker[None, tuple[Frame, int]]
        self._worker = Worker(f"camera {name}", self._source, kept=1, idle=(0.0, None))
        if not self._worker.opened(open_timeout_s):
            raise CameraLost(f"{name}: did not open within {open_timeout_s:g} s")

    @gives_buffers
    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned; raises CameraTimeout or CameraLost."""
        if self._end:
            raise CameraLost(self._end)
        self._asked.set()
        try:
            newest = self._worker.take(timeout_s)
        except CameraLost as error:
            self._end = str(error)
            raise
        if not newest:
            raise CameraLost(self._end) if self._end else CameraTimeout(f"no frame within {timeout_s:g} s")
        frame, count = newest[-1]
        skipped, self._returned = count - self._returned - 1, count
        return replace(frame, dropped=skipped)

    @property
    def exposure_settable(self) -> bool:
        """Whether the exposure can be changed while frames are grabbed."""
        return self._settable

    def set_exposure(self, exposure_s: float) -> float:
        """Expose later frames for so long, s; the exposure that the device took.

        Raises InputError where the device does not take it, or does not answer within `ANSWER_S`.
        """
        future: Future[float] = Future()
        self._exposures.append((exposure_s, future))
        try:
            return future.result(ANSWER_S)
        except TimeoutError:
            raise InputError(f"exposure: the camera did not answer within {ANSWER_S:g} s") from None

    def close(self) -> None:
        """Release the device; safe to call twice."""
        self._end = "it is closed"
        self._worker.close(CLOSING_S)

    @contextmanager
    def _source(self) -> Iterator[Callable[[None], tuple[Frame, int] | None]]:
        source = self._open_source()

        def grab(_: None) -> tuple[Frame, int] | None:
            """A frame, and the number of all frames up to it, lost ones too."""
            if source.on_demand and not self._asked.wait(POLL_S):
                return None
            try:
                while self._exposures:
                    wanted_s, future = self._exposures.popleft()
                    completed(partial(source.set_exposure, wanted_s), future)  # type: ignore[attr-defined]
                given = source.grab()
            except CameraLost:
                raise
            except RAISED as error:  # whatever a maker's library raises during a run: the camera is lost
                raise CameraLost(f"{type(error).__name__}: {' '.join(str(error).split())}") from error
            if given is None:
                return None
            frame = own(given, source.grab)  # the next grab may write into its image
            self._asked.clear()
            self._counted += 1 + frame.dropped
            return frame, self._counted

        try:
            self.serial, self.model = identity_of(source)
            self.shape, self.bits = source.shape, source.bits
            self._settable = bool(getattr(source, "exposure_settable", hasattr(source, "set_exposure")))
            yield grab
        finally:
            source.close()
