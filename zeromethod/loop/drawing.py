"""Warps drawn on the display: by the loop itself in simulated time, else in a thread of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from zeromethod.arrays import Float
from zeromethod.devices.protocols import DisplayLost
from zeromethod.errors import InputError
from zeromethod.loop.drawer import Drawer
from zeromethod.pattern.strips import CODES
from zeromethod.worker import SameThread, Worker

OPENING_S = 60.0
"""How long it may take to make the drawer, and to draw the first picture: shaders are compiled for it."""

CLOSING_S = 0.2
"""How long `close` waits for a picture that is being drawn; a display that hangs is left to its thread."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """One picture that was given to the panel at `time_ns`.

    q: (rows, cols, 2) its warp, LCD px. seen_ns: mid-exposure of the frame behind it, None for none. code: in
    its strips, None for none. draw_ms: to draw and show it.
    """

    time_ns: int
    q: Float
    seen_ns: int | None
    code: int | None
    draw_ms: float


class Drawing:
    """Draws warps and numbers them by codes: at once, or live in a thread of its own, the newest only.

    The drawer is made, used and closed in that thread: a GL context of its own is current nowhere else.
    """

    def __init__(self, make: Callable[[], Drawer], coded: bool, timeout_s: float, live: bool) -> None:
        """timeout_s: a live display that takes longer for a picture hangs.

        Raises what `make` raises, and InputError where it hangs.
        """
        self._make = make
        self._coded = coded
        self._timeout_s = timeout_s
        self._count = 0
        self.gl_renderer = ""
        """Name of what draws, as GL gives it."""
        self._worker: Worker[tuple[Float, int | None], Drawn] | SameThread[tuple[Float, int | None], Drawn]
        self._worker = Worker("drawing", self._drawer) if live else SameThread(self._drawer)
        if not self._worker.opened(OPENING_S):
            self._worker.close(0.0)
            raise InputError(f"display: not ready to be drawn on within {OPENING_S:g} s")

    def post(self, q: Float, seen_ns: int | None) -> None:
        """Draw `q`, which must not change any more; it replaces one that waits. Live, it returns at once.

        seen_ns: as in `Drawn`. Raises DisplayLost, unless live.
        """
        self._worker.post((q, seen_ns))

    def collect(self) -> list[Drawn]:
        """What was drawn since the last call.

        Live, raises what the display raised, after all that was drawn, and DisplayLost where it hangs.
        """
        drawn = self._worker.take()
        busy_s = self._worker.busy_s
        if not drawn and busy_s > (self._timeout_s if self._count else OPENING_S):
            raise DisplayLost(f"it has been showing one picture for {busy_s:.1f} s")
        return drawn

    def close(self) -> None:
        """Draw nothing more; within `CLOSING_S`, and at once when called again. The display stays open."""
        self._worker.close(CLOSING_S)

    @contextmanager
    def _drawer(self) -> Iterator[Callable[[tuple[Float, int | None]], Drawn]]:
        drawer = self._make()

        def draw(request: tuple[Float, int | None]) -> Drawn:
            q, seen_ns = request
            code = self._count % CODES if self._coded else None
            started = time.perf_counter()
            time_ns = drawer.draw(q, code)
            self._count += 1
            return Drawn(time_ns, q, seen_ns, code, 1e3 * (time.perf_counter() - started))

        try:
            self.gl_renderer = drawer.gl_renderer
            yield draw
        finally:
            drawer.close()
