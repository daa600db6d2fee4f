"""The simulated LCD: a display device whose swaps happen at its own refreshes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.clock import Clock
from zeromethod.devices.protocols import DisplayLost
from zeromethod.pattern.response import Response
from zeromethod.rig.model import Rig
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.projected import SimulatedProjector
from zeromethod.simulation.renderer import BenchRenderer
from zeromethod.simulation.timeline import Timeline

if TYPE_CHECKING:
    import moderngl

    from zeromethod.simulation.gpu import GpuRenderer

_STREAM = 1


class SimulatedDisplay:
    """A `Display`; with `simulation.renderer = "gpu"` also a `DrawingDisplay` (`context`, `draw`).

    A picture is swapped in at the first refresh strictly after the call, and the call returns at that time.
    Before the first picture the panel shows the grey of the target's mean light. The display owns the
    renderer that its camera uses; `panel`, `presentations` and `projector` are what that camera sees.
    """

    context: moderngl.Context
    draw: Callable[[Callable[[moderngl.Framebuffer], None]], int]

    def __init__(self, rig: Rig, clock: Clock) -> None:
        """Open; raises InputError when the renderer cannot be made."""
        self._rig = rig
        self._clock = clock
        self.renderer: BenchRenderer
        if rig.simulation.renderer == "gpu":
            self.renderer = self._drawing_renderer()
        else:
            self.renderer = NumpyRenderer(rig)
        display, spec = rig.display, rig.simulation
        refresh_hz = spec.display_refresh_hz or display.refresh_hz
        self.projector = None if rig.projector is None else SimulatedProjector(rig.projector, clock)
        self._vsync = Timeline(refresh_hz, 0.0, spec.display_jitter_s, spec.seed, _STREAM)
        self.panel = SimulatedPanel(display, refresh_hz)
        grey = np.full(
            (display.rows, display.columns), Response.from_rig(display).code(rig.target.mean), np.uint8
        )
        self.presentations = [Presentation(clock.now_ns(), self.renderer.upload(grey))]
        self._needed_from_ns: int | None = None
        self._shows = 0
        self._closed = False

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of the panel, px."""
        return self._rig.display.columns, self._rig.display.rows

    @property
    def refresh_hz(self) -> float:
        """Nominal refresh rate, Hz, as the rig file gives it; the panel's own may differ a little."""
        return self._rig.display.refresh_hz

    def show(self, image: Bytes) -> int:
        """Show (rows, cols) grey codes; return the swap's time, ns, once it has come.

        Raises DisplayLost, or InputError for a picture of another shape or type.
        """
        self._check()
        return self._present(self.renderer.upload(image))

    def keep_from(self, time_ns: int | None) -> None:
        """Let go of pictures that gave no light from `time_ns` on; None = nobody looks at the past."""
        self._needed_from_ns = time_ns
        self._forget()

    def close(self) -> None:
        """Release the renderer; safe to call twice."""
        if not self._closed:
            self._closed = True
            self.renderer.close()

    def _drawing_renderer(self) -> GpuRenderer:
        """GPU renderer, with `context` and `draw` set up for it."""
        from zeromethod.simulation.gpu import GpuRenderer  # noqa: PLC0415 (GL only where it is asked for)

        renderer = GpuRenderer(self._rig)

        def draw(render: Callable[[moderngl.Framebuffer], None]) -> int:
            """Let `render` fill the framebuffer, then swap; as `DrawingDisplay.draw`."""
            self._check()
            handle, framebuffer = renderer.new_picture()
            with renderer.context:
                render(framebuffer)
            return self._present(handle)

        # set on the object, so that without a GPU the display has neither and is no DrawingDisplay
        self.context, self.draw = renderer.context, draw
        return renderer

    def _check(self) -> None:
        if self._closed:
            raise DisplayLost("the simulated display is closed")
        lost_at = self._rig.simulation.faults.display_lost_at_show
        if lost_at is not None and self._shows >= lost_at:
            raise DisplayLost(f"the simulated display was lost at show {lost_at}")

    def _present(self, handle: int) -> int:
        time_ns = self._vsync.time_ns(self._vsync.first_after(self._clock.now_ns()))
        self._clock.sleep_until_ns(time_ns)
        self.presentations.append(Presentation(time_ns, handle))
        self._shows += 1
        self._forget()
        return time_ns

    def _forget(self) -> None:
        needed_ns = self._clock.now_ns() if self._needed_from_ns is None else self._needed_from_ns
        while len(self.presentations) > 1:
            if self.panel.forgotten_at(self.presentations[1].time_ns) >= needed_ns:
                break
            self.renderer.release(self.presentations.pop(0).handle)
