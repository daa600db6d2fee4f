"""Warps drawn on the display: by the loop itself in simulated time, else in a thread of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from zeromethod.arrays import Float, Mask
from zeromethod.clock import Clock
from zeromethod.devices.contract import presented
from zeromethod.devices.protocols import Display, DisplayLost, DrawingDisplay
from zeromethod.errors import InputError
from zeromethod.gl import collect, create_context
from zeromethod.pattern import PatternRenderer, Response, Strips, Target
from zeromethod.pattern.coded import Coded
from zeromethod.pattern.stepping import shift_of
from zeromethod.pattern.strips import CODES
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest
from zeromethod.worker import SameThread, Worker

OPENING_S = 60.0
"""How long it may take to make the drawer, and to draw the first picture: shaders are compiled for it."""

HANGING_S = 5.0
"""How long a later picture may take: on a busy computer without a GPU it takes a second or two now and then,
and a display that hangs ends the run."""

CLOSING_S = 0.2
"""How long `close` waits for a picture that is being drawn; a display that hangs is left to its thread."""


MOST_RENDERERS = 4
"""Targets that are kept ready to be drawn again."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """One picture that was given to the panel at `time_ns`.

    q: (rows, cols, 2) its warp, LCD px. source_ns: mid-exposure of the newest frame that it was made from,
    None for none. code: in its strips, None for none. draw_ms: to draw and show it. coded: number of the
    coded picture drawn over it, None for none. shift: of a moving target, periods along u and v.
    """

    time_ns: int
    q: Float
    source_ns: int | None
    code: int | None
    draw_ms: float
    coded: int | None = None
    shift: tuple[float, float] = (0.0, 0.0)


_Wanted = tuple[Float, int | None, Coded | None, Mask | None]
"""Warp, mid-exposure of the frame it was made from, fringes over it, nodes that are to be white."""


class Drawer:
    """Draws warps on one display: through its own GL context, or as images where it has none.

    A display's own context is only used inside the display's `draw`, where it is current: the renderer is
    made with the first picture.
    """

    def __init__(
        self, rig: Rig, display: Display, clock: Clock, rest: Rest, strips: Strips | None = None
    ) -> None:
        """InputError where no GL context can be had. strips: where codes are drawn."""
        self._rig = rig
        self._strips = strips
        self._rest = rest
        self._display, self._clock = display, clock
        self._renderers: dict[Target, PatternRenderer] = {}
        self.target = Target.from_spec(rig.target)
        """What is drawn; another one from the next picture on, where it is changed."""
        self._drawing = display if isinstance(display, DrawingDisplay) else None
        self._context = self._drawing.context if self._drawing else create_context()

    @property
    def gl_renderer(self) -> str:
        """Name of what draws, as GL gives it."""
        return str(self._context.info["GL_RENDERER"])

    def draw(
        self,
        q: Float,
        code: int | None = None,
        coded: Coded | None = None,
        lamp: Mask | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> int:
        """Show the target warped by `q` (rows, cols, 2) LCD px, with `code` in its strips; time in ns.

        coded: fringes over parts of it. lamp: (rows, cols) nodes that are to be white. shift: of the target,
        periods along u and v. Raises DisplayLost, and as `presented` where the display does not say when.
        """
        if (drawing := self._drawing) is not None:
            show = partial(
                drawing.draw,
                lambda framebuffer: self._renderer().render(framebuffer, q, code, coded, lamp, shift),
            )
        else:
            with self._context:
                image = self._renderer().image(q, code, coded, lamp, shift)
            show = partial(self._display.show, image)
        return presented(show, self._clock, self._rig.display.refresh_hz)

    def close(self) -> None:
        """Free a GL context of its own; a display's belongs to the display."""
        if self._drawing is None:
            self._context.release()

    def _renderer(self) -> PatternRenderer:
        """Renderer of the present target; to be used where the context is current."""
        target = self.target
        if target not in self._renderers:
            if len(self._renderers) >= MOST_RENDERERS:
                self._renderers.clear()
                collect(self._context)
            response, rest = Response.from_rig(self._rig.display), self._rest
            lattice = rest.grid, rest.q, rest.display_size
            renderer = PatternRenderer(
                self._context, *lattice, target, response, self._strips, self._rig.target.carry
            )
            self._renderers[target] = renderer
        return self._renderers[target]


class Drawing:
    """Draws warps and numbers them by codes: at once, or live in a thread of its own, the newest only.

    The drawer is made, used and closed in that thread: a GL context of its own is current nowhere else.
    """

    def __init__(
        self, make: Callable[[], Drawer], coded: bool, timeout_s: float, live: bool, step: int = 0
    ) -> None:
        """timeout_s: a live display that takes longer for a picture hangs. step: of a moving target.

        Raises what `make` raises, and InputError where it hangs.
        """
        self._make = make
        self._coded = coded
        self._timeout_s = timeout_s
        self._count = self._stepped = 0
        self._step = step
        self.gl_renderer = ""
        """Name of what draws, as GL gives it."""
        self.target: Target | None = None
        """In place of the rig's, from the next picture on."""
        self._worker: Worker[_Wanted, Drawn] | SameThread[_Wanted, Drawn]
        self._worker = Worker("drawing", self._drawer) if live else SameThread(self._drawer)
        if not self._worker.opened(OPENING_S):
            raise InputError(f"display: not ready to be drawn on within {OPENING_S:g} s")

    def post(
        self, q: Float, source_ns: int | None, coded: Coded | None = None, lamp: Mask | None = None
    ) -> None:
        """Draw `q`, which must not change any more; it replaces one that waits. Live, it returns at once.

        source_ns: as in `Drawn`. coded, lamp: as `Drawer.draw` takes them. Raises DisplayLost, unless live.
        """
        self._worker.post((q, source_ns, coded, lamp))

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
    def _drawer(self) -> Iterator[Callable[[_Wanted], Drawn]]:
        drawer = self._make()

        def draw(request: _Wanted) -> Drawn:
            q, source_ns, coded, lamp = request
            code = self._count % CODES if self._coded else None
            if self.target is not None:
                drawer.target = self.target
            started = time.perf_counter()
            # while fringes are drawn over it the target rests: their pixels must see the same around them
            shift = shift_of(self._step, self._stepped + (coded is None))
            time_ns = drawer.draw(q, code, coded, lamp, shift)
            self._count += 1
            self._stepped += coded is None
            draw_ms = 1e3 * (time.perf_counter() - started)
            number = None if coded is None else coded.number
            return Drawn(time_ns, q, source_ns, code, draw_ms, number, shift)

        try:
            self.gl_renderer = drawer.gl_renderer
            yield draw
        finally:
            drawer.close()
