"""The LCD as a window on a screen of this computer, drawn in place by OpenGL."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from zeromethod.clock import HostClock
from zeromethod.devices.protocols import DisplayLost
from zeromethod.drivers.glfw_window import GlfwWindow, connect, glfw_errors_as
from zeromethod.errors import InputError
from zeromethod.gl.handle import ContextHandle

_TRIAL_SWAPS = 12
_QUEUED_SWAPS = 4
"""Swaps that a driver may take in at once before the first one waits for the screen."""


class WindowDisplay:
    """A `DrawingDisplay`: a window without frame or cursor, one framebuffer pixel per LCD pixel.

    columns, rows: size of the LCD, px. refresh_hz: its refresh rate, Hz. monitor: index of the monitor to
    fill, which must be set to the LCD's size; None = a window on the primary monitor.

    A call returns once its picture is swapped. Where swaps do not wait for the screen (measured at opening),
    they happen at the refreshes of a clock that starts then. Black until the first picture. To be opened,
    used and closed in the main thread.
    """

    def __init__(self, columns: int, rows: int, refresh_hz: float, monitor: int | None = None) -> None:
        """Open the window; InputError (one line) without a screen, the monitor, or OpenGL 3.3."""
        self._size = columns, rows
        self._refresh_hz = refresh_hz
        self._period_ns = 1e9 / refresh_hz
        self._clock = HostClock()
        self._closed = False
        self._picture: moderngl.Framebuffer | None = None
        with glfw_errors_as(InputError):
            connect()
            handle = ContextHandle(lambda: self._open(monitor))
            settings: dict[str, Any] = {"context": handle}
            try:
                self._context = moderngl.create_context(**settings)
                self._context.gc_mode = "context_gc"
                self._opened_ns, self._paced = self._try_swaps()
                if fault := self._window.fault():
                    raise InputError(f"display window: it {fault}")
            except BaseException:
                handle.release()
                raise

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of the panel, px."""
        return self._size

    @property
    def refresh_hz(self) -> float:
        """Nominal refresh rate, Hz, as the rig file gives it."""
        return self._refresh_hz

    @property
    def context(self) -> moderngl.Context:
        """The GL context of the window."""
        return self._context

    def draw(self, render: Callable[[moderngl.Framebuffer], None]) -> int:
        """Call `render` with the window's framebuffer (red = green = blue = code / 255), then swap.

        LCD row 0 is the top line, y = 1 in clip space. Returns the time after the swap, ns. Raises
        DisplayLost when the window is closed or no longer of the LCD's size, or glfw reports an error.
        """
        if self._closed:
            raise DisplayLost("display window: it is closed")
        with glfw_errors_as(DisplayLost):
            if fault := self._window.fault():
                raise DisplayLost(f"display window: it {fault}")
        with self._context:
            render(self._context.screen)
            with glfw_errors_as(DisplayLost):
                return self._present()

    def show(self, image: NDArray[np.uint8]) -> int:
        """Show (rows, cols) grey codes; return the time after the swap, ns.

        Raises DisplayLost as `draw`, or InputError for a picture of another shape or type.
        """
        expected = self._size[1], self._size[0]
        if image.shape != expected or image.dtype != np.uint8:
            raise InputError(f"picture: shape {image.shape}, {image.dtype}: allowed {expected}, uint8")

        def copy(screen: moderngl.Framebuffer) -> None:
            if self._picture is None:
                self._texture = self._context.texture(self._size, 4)
                self._picture = self._context.framebuffer([self._texture])
            self._texture.write(np.repeat(image[::-1, :, None], 4, axis=2))
            self._context.copy_framebuffer(screen, self._picture)

        return self.draw(copy)

    def close(self) -> None:
        """Close the window; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._context.release()

    def _open(self, monitor: int | None) -> GlfwWindow:
        self._window = GlfwWindow(self._size, monitor)
        return self._window

    def _try_swaps(self) -> tuple[int, bool]:
        """Swap black pictures; time of the last swap, ns, and whether swaps need pacing by the clock."""
        times_ns = []
        with self._context as ctx:
            for _ in range(_TRIAL_SWAPS):
                ctx.screen.clear()
                self._window.swap()
                ctx.finish()
                times_ns.append(self._clock.now_ns())
        interval_ns = float(np.median(np.diff(times_ns[_QUEUED_SWAPS:])))
        return times_ns[-1], interval_ns < 0.5 * self._period_ns

    def _present(self) -> int:
        """Swap, at the next refresh of the clock where the screen does not wait for its own; time, ns."""
        if self._paced:
            self._context.finish()
            passed = (self._clock.now_ns() - self._opened_ns) // self._period_ns
            self._clock.sleep_until_ns(self._opened_ns + math.ceil((passed + 1) * self._period_ns))
        self._window.swap()
        self._context.finish()
        return self._clock.now_ns()
