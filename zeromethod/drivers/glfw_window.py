"""A glfw window with an OpenGL context: monitors, hints, events, and glfw's errors in one line."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import glfw

from zeromethod.errors import InputError

_OPENGL = (3, 3)
_NO_WINDOW: Any = None


@contextmanager
def glfw_errors_as(kind: type[Exception]) -> Iterator[None]:
    """Raise what glfw reports, by default as warnings, as an exception of one line."""
    before, glfw.ERROR_REPORTING = glfw.ERROR_REPORTING, "raise"
    try:
        yield
    except glfw.GLFWError as error:
        # glfw gives "(number) b'text'"
        text = re.sub(r"""^\(\d+\) (?:b(['"])(.*)\1)?""", r"\2", " ".join(str(error).split()))
        raise kind(f"display window: {text}") from error
    finally:
        glfw.ERROR_REPORTING = before


def connect() -> None:
    """Connect to the screen, once per process."""
    try:
        glfw.init()
    except glfw.GLFWError as error:
        if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            raise
        raise InputError("display window: no screen: DISPLAY is not set") from error


def _find_monitor(index: int, size: tuple[int, int]) -> tuple[Any, int]:
    """Monitor of that index and the refresh rate of its mode, Hz; InputError when its size is another."""
    monitors = glfw.get_monitors()
    modes = [glfw.get_video_mode(monitor) for monitor in monitors]
    sizes = [f"{mode.size.width} x {mode.size.height}" for mode in modes]
    if index not in range(len(monitors)):
        names = [os.fsdecode(glfw.get_monitor_name(monitor)) for monitor in monitors]
        listed = ", ".join(f"{i} ({names[i]}, {sizes[i]})" for i in range(len(monitors)))
        raise InputError(f"display.monitor: {index!r}: allowed: {listed or 'none is connected'}")
    wanted = f"{size[0]} x {size[1]}"
    if sizes[index] != wanted:
        raise InputError(f"display.monitor: {index}: set to {sizes[index]}; the rig's display is {wanted} px")
    return monitors[index], modes[index].refresh_rate


class GlfwWindow:
    """A window without frame or cursor and its context, as a `NativeContext`. No other context is current.

    size: (columns, rows) of its framebuffer, px. monitor: index of the one to fill; None = a plain window
    on the primary monitor.
    """

    def __init__(self, size: tuple[int, int], monitor: int | None) -> None:
        """Open it; GLFWError when that fails, InputError without such a monitor."""
        self._full_screen = monitor is not None
        self._size = size
        glfw.default_window_hints()
        glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, _OPENGL[0])
        glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, _OPENGL[1])
        glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
        # AUTO_ICONIFY: else a full-screen window vanishes when another monitor is clicked on
        for hint in (glfw.DECORATED, glfw.RESIZABLE, glfw.AUTO_ICONIFY):
            glfw.window_hint(hint, glfw.FALSE)
        place = None
        if monitor is not None:
            place, refresh_hz = _find_monitor(monitor, size)
            glfw.window_hint(glfw.REFRESH_RATE, refresh_hz)
        self._pointer = glfw.create_window(*size, "zeromethod", place, None)
        glfw.set_input_mode(self._pointer, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        self.bind()
        glfw.swap_interval(1)

    def bind(self) -> None:
        """Make its context current in this thread."""
        glfw.make_context_current(self._pointer)

    def unbind(self) -> None:
        """Make no window's context current in this thread."""
        glfw.make_context_current(_NO_WINDOW)

    def address(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""
        return int(glfw.get_proc_address(name) or 0)

    def destroy(self) -> None:
        """Close the window and free its context."""
        glfw.destroy_window(self._pointer)

    def swap(self) -> None:
        """Show what was drawn; returns once the GPU is done with it."""
        glfw.swap_buffers(self._pointer)

    def fault(self) -> str | None:
        """What keeps the window from being the LCD, in words, after looking at its events."""
        glfw.poll_events()
        if glfw.window_should_close(self._pointer):
            return "was closed"
        if self._full_screen and not glfw.get_window_monitor(self._pointer):
            return "lost its monitor"
        size = glfw.get_framebuffer_size(self._pointer)
        if size != self._size:
            return f"is {size[0]} x {size[1]} px instead of {self._size[0]} x {self._size[1]}"
        return None
