"""A camera that is grabbed in a thread of its own: reading is quick, and a hung device hangs nothing."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Protocol

from zeromethod.devices.abilities import identity_of
from zeromethod.devices.protocols import CameraLost, Frame
from zeromethod.drivers.newest import Newest

CLOSING_S = 0.5
"""How long `close` waits for the device; a hung one is left to its thread."""

POLL_S = 0.1
"""How long a source may wait for a frame before it looks whether it is to end."""


class Source(Protocol):
    """A device as the grabbing thread has it. All members are used in that thread only.

    It may also have `serial` and `model`, text.
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
        """Next frame; None when none came for a moment (`POLL_S`). Raises CameraLost."""

    def close(self) -> None:
        """Release the device."""


@dataclass(frozen=True)
class _Opened:
    shape: tuple[int, int]
    bits: int
    serial: str
    model: str


@dataclass
class _Link:
    """What the two threads share."""

    newest: Newest = field(default_factory=Newest)
    opened: Future[_Opened] = field(default_factory=Future)
    asked: threading.Event = field(default_factory=threading.Event)
    stop: threading.Event = field(default_factory=threading.Event)


def _grab(open_source: Callable[[], Source], link: _Link) -> None:
    """Body of the thread: open, grab until told to stop, close."""
    try:
        source = open_source()
    except BaseException as error:
        link.opened.set_exception(error)
        return
    try:
        link.opened.set_result(_Opened(source.shape, source.bits, *identity_of(source)))
        while not link.stop.is_set():
            if source.on_demand and not link.asked.wait(POLL_S):
                continue
            frame = source.grab()
            if frame is not None:
                link.asked.clear()
                link.newest.put(frame)
    except CameraLost as error:
        link.newest.end(str(error))
    except Exception as error:  # what a maker's library raises in the midst of a run means that it is gone
        link.newest.end(f"{type(error).__name__}: {' '.join(str(error).split())}")
    finally:
        try:
            source.close()
        except Exception as error:
            link.newest.end(f"cannot be closed: {' '.join(str(error).split())}")


class GrabbedCamera:
    """A `Camera` over a `Source`, which is opened, grabbed and closed in one daemon thread.

    `read` returns the newest frame not yet returned, and what it skips counts as dropped. With a source on
    demand each `read` asks for an exposure. `close` returns within half a second: a device that hangs is
    left to its thread, which closes it as soon as it answers and does not keep the program from ending.
    """

    def __init__(self, name: str, open_source: Callable[[], Source], open_timeout_s: float) -> None:
        """Open it; raises what `open_source` raises, CameraLost when that takes over `open_timeout_s`."""
        self._link = _Link()
        self._thread = threading.Thread(
            target=_grab, args=(open_source, self._link), name=f"camera {name}", daemon=True
        )
        self._thread.start()
        try:
            self._opened = self._link.opened.result(open_timeout_s)
        except BaseException as error:
            self._link.stop.set()
            if isinstance(error, TimeoutError) and not self._link.opened.done():
                raise CameraLost(f"{name}: did not open within {open_timeout_s:g} s") from None
            raise

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""
        return self._opened.shape

    @property
    def bits(self) -> int:
        """Significant bits per pixel: 8 to 16."""
        return self._opened.bits

    @property
    def serial(self) -> str:
        """Serial number of the device, "" where it tells none."""
        return self._opened.serial

    @property
    def model(self) -> str:
        """Model of the device, "" where it tells none."""
        return self._opened.model

    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned; raises CameraTimeout or CameraLost."""
        if self._link.stop.is_set():
            raise CameraLost("it is closed")
        self._link.asked.set()
        return self._link.newest.take(timeout_s)

    def close(self) -> None:
        """Release the device; safe to call twice."""
        self._link.stop.set()
        self._link.newest.end("it is closed")
        self._thread.join(CLOSING_S)
