"""The monitors of this computer, by the index that `display.monitor` takes."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import glfw

from zeromethod.drivers.desktop import Desktop
from zeromethod.drivers.glfw_window import connect, glfw_errors_as
from zeromethod.errors import InputError

_RATE_TOLERANCE = 0.02


@dataclass(frozen=True, slots=True)
class Monitor:
    """A monitor as the desktop has set it.

    index: 0 is the primary one. columns, rows: px. refresh_hz: 0 when not known. x, y: its top left corner
    on the desktop, px. scale: the desktop's. warnings: what changes pictures there, one line each.
    """

    index: int
    name: str
    columns: int
    rows: int
    refresh_hz: float
    x: int
    y: int
    scale: float
    primary: bool
    warnings: tuple[str, ...] = ()

    def runs_at(self, refresh_hz: float) -> bool:
        """Whether it is set to a rate, as far as is known."""
        return not self.refresh_hz or abs(self.refresh_hz / refresh_hz - 1) <= _RATE_TOLERANCE

    def __str__(self) -> str:
        size = f"{self.columns} x {self.rows}"
        rate = f", {self.refresh_hz:.2f} Hz" if self.refresh_hz else ""
        return f"{self.index} ({self.name}, {size}{rate}, at {self.x}, {self.y})"


class Claim:
    """A monitor of the present desktop, claimed for one program: a second pattern would hide the first.

    It lasts until `release`, or until the program ends, however that comes about.
    """

    def __init__(self, index: int) -> None:
        """Raises InputError when another claim lasts."""
        desktop = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY", "")
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            # an abstract socket: no file is left behind
            self._socket.bind(f"\0zeromethod monitor {index} of {desktop}")
        except OSError:
            self._socket.close()
            raise InputError(f"display window: monitor {index} shows another zeromethod's pattern") from None

    def release(self) -> None:
        """End the claim; safe to call twice."""
        self._socket.close()


def monitors() -> tuple[Monitor, ...]:
    """Monitors in the order of their indices; within a few seconds, in the main thread.

    Returns
    -------
    tuple of Monitor
        All of them.

    Raises
    ------
    InputError
        Without a screen, or when its server does not answer.
    """
    with glfw_errors_as(InputError):
        desktop = Desktop(connect())
        try:
            return described(desktop)
        finally:
            desktop.close()


def described(desktop: Desktop) -> tuple[Monitor, ...]:
    """Monitors as `monitors`, once glfw is connected; raises GLFWError."""
    return tuple(_describe(index, monitor, desktop) for index, monitor in enumerate(glfw.get_monitors()))


def by_index(known: Sequence[Monitor], index: int, where: str) -> Monitor:
    """The monitor of an index, which `where` gives; InputError (one line) that lists the monitors."""
    if index not in range(len(known)):
        raise InputError(f"{where}: {index!r}: allowed: {listed(known)}")
    return known[index]


def listed(known: Sequence[Monitor]) -> str:
    """Monitors in one line."""
    return ", ".join(map(str, known)) or "none is connected"


def find(index: int, size: tuple[int, int], refresh_hz: float, desktop: Desktop) -> tuple[Any, Monitor]:
    """The glfw monitor of an index, which must be set to (columns, rows) and, within 2 %, to refresh_hz.

    InputError (one line) that lists the monitors when there is no such index, or says what is set.
    """
    found = by_index(described(desktop), index, "display.monitor")
    wanted = f"{size[0]} x {size[1]}"
    if (found.columns, found.rows) != size:
        is_set = f"{found.columns} x {found.rows}"
        raise InputError(f"display.monitor: {index}: set to {is_set}; the rig's display is {wanted} px")
    if not found.runs_at(refresh_hz):
        is_set = f"{found.refresh_hz:.2f} Hz"
        raise InputError(
            f"display.monitor: {index}: set to {is_set}; the rig's display has {refresh_hz:g} Hz"
        )
    return glfw.get_monitors()[index], found


def _describe(index: int, monitor: Any, desktop: Desktop) -> Monitor:
    mode = glfw.get_video_mode(monitor)
    return Monitor(
        index,
        os.fsdecode(glfw.get_monitor_name(monitor)),
        *mode.size,
        desktop.refresh_hz(monitor),
        *glfw.get_monitor_pos(monitor),
        scale=max(glfw.get_monitor_content_scale(monitor)),
        primary=index == 0,
        warnings=desktop.monitor_warnings(monitor),
    )
