"""Who waits for the display: the loop itself, in simulated time, or a thread that draws and swaps for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from zeromethod.arrays import Float
from zeromethod.devices.protocols import DisplayLost
from zeromethod.errors import InputError
from zeromethod.loop.drawer import Presenter
from zeromethod.pattern.strips import CODES

OPENING_S = 60.0
"""How long it may take to find what draws, and to draw the first picture: shaders are compiled for it."""

CLOSING_S = 0.2
"""How long `close` waits for a picture that is being drawn; a display that hangs is left to its thread."""


@dataclass(frozen=True, slots=True)
class Presented:
    """One picture that was given to the panel at `time_ns`.

    q: (rows, cols, 2) its warp, LCD px. seen_ns: mid-exposure of the frame behind it, None for none. code: in
    its strips, None for none. draw_ms: to draw and present it.
    """

    time_ns: int
    q: Float
    seen_ns: int | None
    code: int | None
    draw_ms: float


class Presenting(Protocol):
    """Takes warps to show, and tells what was shown."""

    @property
    def gl_renderer(self) -> str:
        """Name of what draws, as GL gives it."""

    def post(self, q: Float, seen_ns: int | None) -> None:
        """Show `q`, which must not change any more; one that was not yet drawn is replaced."""

    def collect(self) -> list[Presented]:
        """What was presented since the last call; then what the display raised is raised."""

    def close(self) -> None:
        """Show nothing more; the display stays open."""


class _Counted:
    """Presents with running codes."""

    def __init__(self, presenter: Presenter, coded: bool) -> None:
        self._presenter = presenter
        self._coded = coded
        self._count = 0

    def present(self, q: Float, seen_ns: int | None) -> Presented:
        code = self._count % CODES if self._coded else None
        started = time.perf_counter()
        time_ns = self._presenter.present(q, code)
        self._count += 1
        return Presented(time_ns, q, seen_ns, code, 1e3 * (time.perf_counter() - started))


class InTurn:
    """Presents at once, in the thread of the loop."""

    def __init__(self, make: Callable[[], Presenter], coded: bool) -> None:
        presenter = make()
        self.gl_renderer = presenter.gl_renderer
        self._presenter = _Counted(presenter, coded)
        self._done: list[Presented] = []

    def post(self, q: Float, seen_ns: int | None) -> None:
        """Show `q`; raises DisplayLost."""
        self._done.append(self._presenter.present(q, seen_ns))

    def collect(self) -> list[Presented]:
        """What was presented since the last call."""
        done, self._done = self._done, []
        return done

    def close(self) -> None:
        """Nothing is under way; what draws is free for another loop over the same display."""


class InThread:
    """Presents in a thread of its own, the newest warp only.

    What draws is made, used and freed in that thread: a GL context of its own is current nowhere else.
    """

    def __init__(self, make: Callable[[], Presenter], coded: bool, timeout_s: float) -> None:
        """timeout_s: a picture that takes longer means that the display hangs.

        Raises what `make` raises, and InputError where it hangs.
        """
        self._timeout_s = timeout_s
        self._changed = threading.Condition()
        self._next: tuple[Float, int | None] | None = None
        self._done: list[Presented] = []
        self._error: BaseException | None = None
        self._began_s: float | None = None
        self._first = True
        self._closed = False
        ready: Future[str] = Future()
        self._thread = threading.Thread(
            target=self._serve, args=(make, coded, ready), name="present", daemon=True
        )
        self._thread.start()
        try:
            self.gl_renderer = ready.result(OPENING_S)
        except TimeoutError:
            self._closed = True
            raise InputError(f"display: not ready to be drawn on within {OPENING_S:g} s") from None

    def post(self, q: Float, seen_ns: int | None) -> None:
        """Show `q` next, in place of one that waits still. Returns at once."""
        with self._changed:
            self._next = q, seen_ns
            self._changed.notify_all()

    def collect(self) -> list[Presented]:
        """What was presented since the last call.

        Raises what the display raised, after all that it showed, and DisplayLost where it hangs.
        """
        with self._changed:
            done, self._done = self._done, []
            if done:
                return done
            if self._error is not None:
                raise self._error
            if self._began_s is not None:
                hung_s = time.monotonic() - self._began_s
                if hung_s > (OPENING_S if self._first else self._timeout_s):
                    raise DisplayLost(f"it has been showing one picture for {hung_s:.1f} s")
            return []

    def close(self) -> None:
        """Show nothing more; within `CLOSING_S`, and at once when called again."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        self._thread.join(CLOSING_S)

    def _serve(self, make: Callable[[], Presenter], coded: bool, ready: Future[str]) -> None:
        try:
            presenter = make()
            ready.set_result(presenter.gl_renderer)
        except BaseException as error:
            ready.set_exception(error)
            return
        try:
            counted = _Counted(presenter, coded)
            while (item := self._await()) is not None:
                presented = counted.present(*item)
                with self._changed:
                    self._done.append(presented)
                    self._began_s = None
                    self._first = False
        except BaseException as error:  # whatever it is, it belongs to the thread of the loop
            with self._changed:
                self._error = error
                self._began_s = None
        finally:
            presenter.close()

    def _await(self) -> tuple[Float, int | None] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._next is not None or self._closed)
            if self._closed:
                return None
            item, self._next = self._next, None
            self._began_s = time.monotonic()
            return item
