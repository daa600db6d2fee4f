"""What the LCD shows: which command is drawn when, and what was presented since the step before."""

from __future__ import annotations

from zeromethod.arrays import Mask
from zeromethod.clock import Clock
from zeromethod.loop.circle import Circle
from zeromethod.loop.drawing import Drawing, Drawn
from zeromethod.loop.pattern_dwell import PatternDwell

REPAINT_S = 1.0
"""In the host's time a picture is drawn again after so long: what covered or blanked the LCD may be gone, but
nothing new to show comes of a dark frame."""

LAMP_S = 0.5
"""How long a lamp stays when nobody asks for it again: without readings, none knows what touches."""


class Screen:
    """Draws the circle's commands and notes in its log what was presented.

    dwell: decides how long each picture stays; None where every command is drawn at once. What the display
    raises is raised here.
    """

    def __init__(
        self, drawing: Drawing, circle: Circle, clock: Clock, dwell: PatternDwell | None, repaints: bool
    ) -> None:
        self.presented: list[Drawn] = []
        """Pictures presented since `begin`."""
        self.presented_before = 0
        """How many of them before the step's frame was looked at."""
        self.lamp: Mask | None = None
        """(rows, cols) nodes that are white in what is drawn next."""
        self.dwell = dwell
        self._drawing = drawing
        self._circle = circle
        self._clock = clock
        self._repaints = repaints
        self._undrawn = False
        self._posted_ns = 0
        self._asked: tuple[Mask | None, int] = None, 0
        self._drawn_lamp: Mask | None = None

    def light(self, lamp: Mask | None, now_ns: int) -> None:
        """Draw white at (rows, cols) nodes with the next `offer`, for `LAMP_S` at most; from any thread."""
        self._asked = lamp, now_ns

    def begin(self) -> None:
        """Begin a step."""
        self.presented, self.presented_before = [], 0

    def draw(self) -> None:
        """Have the present command drawn."""
        self._undrawn = False
        self._posted_ns = self._clock.now_ns()
        self._drawn_lamp = lamp = self.lamp
        circle = self._circle
        self._drawing.post(circle.commanded.q, circle.source_ns, circle.coded, lamp)

    def repaint_if_due(self) -> None:
        """Draw the command again where it has stood for `REPAINT_S` of the host's time."""
        if self._repaints and self._posted_ns and self._clock.now_ns() - self._posted_ns > 1e9 * REPAINT_S:
            self.draw()

    def frame_arrived(self) -> None:
        """Note what was presented up to the moment at which a frame came to hand."""
        self.collect()
        self.presented_before = len(self.presented)

    def offer(self, changed: bool, frozen: bool, now_ns: int) -> None:
        """Draw the command if it changed, or has not been drawn yet, and its time has come."""
        lamp, since_ns = self._asked
        self.lamp = lamp if now_ns - since_ns < 1e9 * LAMP_S else None
        self._undrawn |= changed or self.lamp is not self._drawn_lamp
        if self._undrawn and not frozen and (self.dwell is None or self.dwell.may_present(now_ns)):
            self.draw()
            self.collect()

    def collect(self) -> None:
        """Note in the log what was presented."""
        for one in self._drawing.collect():
            self._circle.presented(
                one.time_ns, one.q, one.code, source_ns=one.source_ns, coded=one.coded, shift=one.shift
            )
            if self.dwell is not None:
                self.dwell.presented(one.time_ns)
            self.presented.append(one)

    def timing_ms(self) -> dict[str, float]:
        """Drawing, and mid-exposure to half-lit, of the newest picture of this step, ms; NaN for none."""
        draw_ms = delay_ms = float("nan")
        if self.presented:
            newest = self.presented[-1]
            draw_ms = newest.draw_ms
            if newest.source_ns is not None:
                lit_ns = newest.time_ns + self._circle.exposures.timing.half_lit_ns
                delay_ms = 1e-6 * (lit_ns - newest.source_ns)
        return {"draw_ms": draw_ms, "delay_ms": delay_ms}

    def close(self) -> None:
        """Draw nothing more; the display stays open."""
        self._drawing.close()
