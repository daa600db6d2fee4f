"""The LCD as a window on a screen of this computer, drawn in place by OpenGL."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.clock import HostClock
from zeromethod.devices.protocols import DisplayLost
from zeromethod.drivers import monitors
from zeromethod.drivers.desktop import Desktop
from zeromethod.drivers.glfw_window import GlfwWindow, connect, glfw_errors_as
from zeromethod.drivers.refresh import Refreshes
from zeromethod.errors import InputError
from zeromethod.gl.handle import ContextHandle, current_context_kept

_TRIALS = 3
_TRIAL_SWAPS = 16
_QUEUED_SWAPS = 4
"""Swaps that a driver may take in at once before the first one waits for the screen."""
_LOOK_AGAIN_S = 1.0
_HUNG_S = 0.5


class WindowDisplay:
    """A `DrawingDisplay`: a window without frame or cursor, one framebuffer pixel per LCD pixel.

    columns, rows: size of the LCD, px. refresh_hz: its refresh rate, Hz. monitor: index of the monitor to
    fill, which must be set to the LCD's size and rate; None = a window on the primary monitor.

    A call returns once its picture is swapped. Where swaps do not wait for the screen (measured at opening),
    they happen at the refreshes of a clock that starts then. Black until the first picture.

    To be opened, polled and closed in the main thread. Pictures may be drawn there or in one other thread;
    then the main thread polls, for only it may look at the window's events.
    """

    context: moderngl.Context
    """The GL context of the window."""
    warnings: tuple[str, ...]
    """What the operator should know, one line each, as `poll` last found it."""
    asleep: bool
    """Whether power saving has turned the LCD off, as `poll` last found it."""

    def __init__(self, columns: int, rows: int, refresh_hz: float, monitor: int | None = None) -> None:
        """Open the window; InputError (one line) without a screen, the monitor, or OpenGL 3.3."""
        self.size = columns, rows
        """(columns, rows) of the panel, px."""
        self.refresh_hz = refresh_hz
        """Nominal refresh rate, Hz, as the rig file gives it."""
        self._clock = HostClock()
        self._opener = threading.get_ident()
        self._drawing = threading.Lock()
        self._closed = False
        self._fault: str | None = None
        self._picture: moderngl.Framebuffer | None = None
        self._claim: monitors.Claim | None = None
        with glfw_errors_as(InputError):
            self._desktop = Desktop(connect())
            try:
                self._open(monitor)
            except BaseException:
                self._unclaim()
                self._desktop.close()
                raise

    def _open(self, monitor: int | None) -> None:
        place = None
        self.name = ""
        """The monitor's name, "" for a plain window."""
        if monitor is not None:
            place, found = monitors.find(monitor, self.size, self.refresh_hz, self._desktop)
            self.name = found.name
            self._claim = monitors.Claim(monitor)
        with current_context_kept():
            self._open_on(place)

    def _open_on(self, place: Any) -> None:
        """Open the window on a glfw monitor, None = the primary one, and time its swaps."""
        handle = ContextHandle(lambda: self._create(place))
        settings: dict[str, Any] = {"context": handle}
        try:
            self.context = moderngl.create_context(**settings)
            self.context.gc_mode = "context_gc"
            self.context.info  # noqa: B018 (asked for while current; kept from then on)
            self._refreshes = Refreshes(self._clock, self.refresh_hz)
            for _ in range(_TRIALS):
                if not self._refreshes.paced:
                    self._refreshes.judge(self._try_swaps())
            self._desktop.keep_awake()
            if fault := self._window.fault():
                raise InputError(f"display window: it {fault}")
            self._look()
        except BaseException:
            handle.release()
            raise

    @property
    def dropped_refreshes(self) -> int:
        """Refreshes missed so far: see `Refreshes.end`."""
        return self._refreshes.dropped

    @property
    def key_pressed(self) -> bool:
        """Whether a key has been pressed in the window."""
        return self._window.key_pressed

    def poll(self) -> None:
        """Look at the window's events and, once a second, at the desktop; in the main thread.

        Raises DisplayLost when the window is closed, minimised, moved, no longer of the LCD's size or has
        lost its monitor, or glfw reports an error.
        """
        if self._closed:
            raise DisplayLost("display window: it is closed")
        with glfw_errors_as(DisplayLost):
            self._fault = self._window.fault()
            if self._fault is None and self._clock.now_ns() > self._looked_ns + _LOOK_AGAIN_S * 1e9:
                self._look()
        self._raise_fault()

    def draw(self, render: Callable[[moderngl.Framebuffer], None]) -> int:
        """Call `render` with the window's framebuffer (red = green = blue = code / 255), then swap.

        LCD row 0 is the top line, y = 1 in clip space. Returns the time after the swap, ns. Raises
        DisplayLost as `poll`.
        """
        if threading.get_ident() == self._opener:
            self.poll()
        with self._drawing:
            if self._closed:
                raise DisplayLost("display window: it is closed")
            self._raise_fault()
            self._refreshes.begin()
            with self.context, glfw_errors_as(DisplayLost):
                render(self.context.screen)
                if self._refreshes.paced:
                    self._window.finish()
                self._refreshes.wait()
                self._window.swap()
                self._window.finish()
                return self._refreshes.end()

    def show(self, image: Bytes) -> int:
        """Show (rows, cols) grey codes; return the time after the swap, ns.

        Raises DisplayLost as `draw`, or InputError for a picture of another shape or type.
        """
        expected = self.size[1], self.size[0]
        if image.shape != expected or image.dtype != np.uint8:
            raise InputError(f"picture: shape {image.shape}, {image.dtype}: allowed {expected}, uint8")

        def copy(screen: moderngl.Framebuffer) -> None:
            if self._picture is None:
                self._texture = self.context.texture(self.size, 4)
                self._picture = self.context.framebuffer([self._texture])
            self._texture.write(np.repeat(image[::-1, :, None], 4, axis=2))
            self.context.copy_framebuffer(screen, self._picture)

        return self.draw(copy)

    def close(self) -> None:
        """Close the window, in the main thread; safe to call twice."""
        if self._closed:
            return
        self._closed = True
        self._unclaim()
        self._desktop.close()
        # A swap that hangs still needs the window: it then stays open until the process ends.
        if self._drawing.acquire(timeout=_HUNG_S):
            self.context.release()
            self._drawing.release()

    def _unclaim(self) -> None:
        if self._claim is not None:
            self._claim.release()

    def _raise_fault(self) -> None:
        if self._fault:
            raise DisplayLost(f"display window: it {self._fault}")

    def _create(self, monitor: Any) -> GlfwWindow:
        self._window = GlfwWindow(self.size, monitor)
        return self._window

    def _look(self) -> None:
        """Note what the desktop does to the picture."""
        asleep, place = self._desktop.asleep(), self._window.monitor
        found = [asleep] if asleep else []
        found += self._desktop.session_warnings()
        found += self._desktop.monitor_warnings(place) if place else ()
        if self._refreshes.paced:
            rate = f"{self.refresh_hz:g} Hz"
            found.append(f"swaps do not wait for the screen: paced by the clock at {rate}, may tear")
        self.warnings, self.asleep = tuple(found), bool(asleep)
        self._looked_ns = self._clock.now_ns()

    def _try_swaps(self) -> list[tuple[int, int]]:
        """Swap black pictures; time before and after each, ns."""
        times_ns = []
        with self.context as ctx:
            for _ in range(_TRIAL_SWAPS):
                ctx.screen.clear()
                self._window.finish()
                before_ns = self._clock.now_ns()
                self._window.swap()
                self._window.finish()
                times_ns.append((before_ns, self._clock.now_ns()))
        return times_ns[_QUEUED_SWAPS:]
