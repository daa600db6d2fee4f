"""The target pattern drawn through a warp on the display."""

from __future__ import annotations

from zeromethod.arrays import Float
from zeromethod.devices.protocols import Display, DrawingDisplay
from zeromethod.gl import create_context
from zeromethod.pattern import PatternRenderer, Response, Strips, Target
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest


class Drawer:
    """Draws warps on one display: through its own GL context, or as images where it has none.

    A display's own context is only used inside the display's `draw`, where it is current: the renderer is
    made with the first picture.
    """

    def __init__(self, rig: Rig, display: Display, rest: Rest, strips: Strips | None = None) -> None:
        """InputError where no GL context can be had. strips: where codes are drawn."""
        self._rig = rig
        self._strips = strips
        self._rest = rest
        self._display = display
        self._drawing = display if isinstance(display, DrawingDisplay) else None
        self._context = self._drawing.context if self._drawing else create_context()
        self._prepared: PatternRenderer | None = None

    @property
    def gl_renderer(self) -> str:
        """Name of what draws, as GL gives it."""
        return str(self._context.info["GL_RENDERER"])

    def draw(self, q: Float, code: int | None = None) -> int:
        """Show the target warped by `q` (rows, cols, 2) LCD px, with `code` in its strips; time in ns.

        Raises DisplayLost; TypeError where the display does not say when.
        """
        if self._drawing is not None:
            time_ns = self._drawing.draw(lambda framebuffer: self._renderer().render(framebuffer, q, code))
        else:
            with self._context:
                image = self._renderer().image(q, code)
            time_ns = self._display.show(image)
        return round(time_ns)

    def close(self) -> None:
        """Free a GL context of its own; a display's belongs to the display."""
        if self._drawing is None:
            self._context.release()

    def _renderer(self) -> PatternRenderer:
        if self._prepared is None:
            self._prepared = PatternRenderer(
                self._context,
                self._rest.grid,
                self._rest.q,
                self._rest.display_size,
                Target.from_spec(self._rig.target),
                Response.from_rig(self._rig.display),
                self._strips,
            )
        return self._prepared
