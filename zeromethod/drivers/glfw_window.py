"""A glfw window with an OpenGL context: hints, events, and glfw's errors in one line."""

from __future__ import annotations

import ctypes
import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import glfw

from zeromethod.drivers.xserver import XServer
from zeromethod.errors import InputError

_OPENGL = (3, 3)
_NO_WINDOW: Any = None
_CATCH_UP_S = 0.3


class _Reporting:
    """glfw has one way of reporting for all threads: the first user changes it, the last puts it back."""

    lock = threading.Lock()
    users = 0
    before: Any = None


@contextmanager
def glfw_errors_as(kind: type[Exception]) -> Iterator[None]:
    """Raise what glfw reports, by default as warnings, as an exception of one line; in any thread."""
    with _Reporting.lock:
        if not _Reporting.users:
            _Reporting.before, glfw.ERROR_REPORTING = glfw.ERROR_REPORTING, "raise"
        _Reporting.users += 1
    try:
        yield
    except glfw.GLFWError as error:
        # glfw gives "(number) b'text'"
        text = re.sub(r"""^\(\d+\) (?:b(['"])(.*)\1)?""", r"\2", " ".join(str(error).split()))
        raise kind(f"display window: {text}") from error
    finally:
        with _Reporting.lock:
            _Reporting.users -= 1
            if not _Reporting.users:
                glfw.ERROR_REPORTING = _Reporting.before


def connect() -> XServer | None:
    """Connect glfw to the screen, once per process, and to its X server if it is one.

    GLFWError when that fails; InputError without a screen or when the server does not answer in time.
    """
    server = _reach_server()
    try:
        glfw.init()
        if server:
            _catch_up(server)
    except glfw.GLFWError as error:
        if server:
            server.close()
        if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            raise
        raise InputError("display window: no screen: DISPLAY is not set") from error
    return server


def _reach_server() -> XServer | None:
    """Connect to the server first: glfw would wait for it without end."""
    if "X11" not in str(glfw.get_version_string()) or not os.environ.get("DISPLAY"):
        return None
    try:
        return XServer()
    except OSError:
        return None


def _catch_up(server: XServer) -> None:
    """Update glfw, which may have started long ago, with monitors that have come, gone or moved since."""
    until = time.monotonic() + _CATCH_UP_S
    lit = {(output.name, output.x, output.y) for output in server.outputs()}
    while True:
        glfw.poll_events()
        known = glfw.get_monitors()
        names = [os.fsdecode(glfw.get_monitor_name(monitor)) for monitor in known]
        places = [glfw.get_monitor_pos(monitor) for monitor in known]
        if {(name, *place) for name, place in zip(names, places, strict=True)} == lit or not lit:
            return
        if time.monotonic() > until:
            return
        time.sleep(0.01)


class GlfwWindow:
    """A window without frame or cursor and its context, as a `NativeContext`. No other context is current.

    size: (columns, rows) of its framebuffer, px. monitor: glfw's, set to that size, to be filled; None = a
    plain window on the primary monitor.
    """

    def __init__(self, size: tuple[int, int], monitor: Any) -> None:
        """Open it; GLFWError when that fails."""
        self._full_screen = monitor is not None
        self._size = size
        glfw.default_window_hints()
        glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, _OPENGL[0])
        glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, _OPENGL[1])
        glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
        # AUTO_ICONIFY: else a full-screen window vanishes when another monitor is clicked on
        for hint in (glfw.DECORATED, glfw.RESIZABLE, glfw.AUTO_ICONIFY):
            glfw.window_hint(hint, glfw.FALSE)
        if monitor is not None:
            glfw.window_hint(glfw.REFRESH_RATE, glfw.get_video_mode(monitor).refresh_rate)
        self._pointer = glfw.create_window(*size, "zeromethod", monitor, None)
        self.key_pressed = False
        glfw.set_key_callback(self._pointer, self._note_key)
        glfw.set_input_mode(self._pointer, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        self.bind()
        glfw.swap_interval(1)
        self._gl_finish = ctypes.CFUNCTYPE(None)(self.address("glFinish"))

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

    def finish(self) -> None:
        """Wait until all that was drawn is on the screen, while other threads go on.

        moderngl's own `finish` keeps the interpreter to itself, for a whole refresh where swaps wait.
        """
        self._gl_finish()

    def swap(self) -> None:
        """Show what was drawn; returns once the GPU is done with it."""
        glfw.swap_buffers(self._pointer)

    @property
    def monitor(self) -> Any:
        """The glfw monitor that it fills, or the primary one; None without any."""
        return glfw.get_window_monitor(self._pointer) if self._full_screen else glfw.get_primary_monitor()

    def fault(self) -> str | None:
        """Why the window cannot serve as the LCD, in words, after handling its events."""
        glfw.poll_events()
        if glfw.window_should_close(self._pointer):
            return "was closed"
        if glfw.get_window_attrib(self._pointer, glfw.ICONIFIED):
            return "was minimised"
        if self._full_screen and not glfw.get_window_monitor(self._pointer):
            return "lost its monitor"
        size = glfw.get_framebuffer_size(self._pointer)
        if size != self._size:
            return f"is {size[0]} x {size[1]} px instead of {self._size[0]} x {self._size[1]}"
        return self._misplaced() if self._full_screen else None

    def _misplaced(self) -> str | None:
        """Whether its monitor has been set to another mode or place, in words."""
        monitor = glfw.get_window_monitor(self._pointer)
        mode = glfw.get_video_mode(monitor).size
        if tuple(mode) != self._size:
            return f"is on a monitor now set to {mode[0]} x {mode[1]} px"
        at, place = glfw.get_window_pos(self._pointer), glfw.get_monitor_pos(monitor)
        if at != place:
            return f"is at {at[0]}, {at[1]} of the desktop; its monitor is at {place[0]}, {place[1]}"
        return None

    def _note_key(self, _window: object, _key: int, _scan: int, action: int, _mods: int) -> None:
        self.key_pressed = self.key_pressed or action == glfw.PRESS
