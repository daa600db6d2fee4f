"""The desktop's changes to pictures on their way to a monitor, as far as they are known, in words."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import glfw
import numpy as np

from zeromethod.drivers.xserver import Output, XServer

_SCALE_TOLERANCE = 0.1
"""Desktops scale in steps of a quarter; a server's own rounding of millimetres stays below."""
_RAMP_TOLERANCE = 1.5 / 255
"""Of full scale: servers differ by one code in what they call linear."""
_OWN_POWER_SAVING = {"GNOME", "KDE", "X-Cinnamon"}


class Desktop:
    """The desktop around the windows; in the main thread, after glfw's start."""

    def __init__(self, server: XServer | None) -> None:
        """server: None = no X server."""
        self._server = server
        self._kept_awake = False

    def keep_awake(self) -> None:
        """Light the monitors; turn screen saver and power saving off until `close`, or the process ends."""
        self._kept_awake = self._server is not None and self._server.keep_awake()

    def asleep(self) -> str:
        """Monitors that power saving has turned off, in words; "" when lit or not known."""
        state = self._server.asleep() if self._server else ""
        return state and f"the LCD is asleep (power saving: {state})"

    def session_warnings(self) -> tuple[str, ...]:
        """Warnings for every monitor: Wayland, power saving that cannot be turned off."""
        said = []
        if on_wayland():
            said.append(
                "Wayland session: the desktop may put the window on another monitor, scale it and change its "
                "greys, which zeromethod cannot detect; log in to an X11 session"
            )
        if not self._kept_awake:
            said.append(
                "screen saver and power saving cannot be turned off from here: turn them off in the settings"
            )
        else:
            own = set(os.environ.get("XDG_CURRENT_DESKTOP", "").split(":")) & _OWN_POWER_SAVING
            said += [f"{name} may blank the screen by itself: turn that off in its settings" for name in own]
        return tuple(said)

    def monitor_warnings(self, monitor: Any) -> tuple[str, ...]:
        """Changes to pictures on a glfw monitor: scaled, mirrored, turned, greys changed."""
        name = os.fsdecode(glfw.get_monitor_name(monitor))
        scale = max(glfw.get_monitor_content_scale(monitor))
        said = []
        if abs(scale - 1) > _SCALE_TOLERANCE:
            said.append(f"{name}: desktop scaling {scale:.0%}: set it to 100 %")
        said += output_warnings(name, self._server.outputs() if self._server else ())
        if ramp := _gamma_ramp(monitor):
            said += ramp_warnings(name, ramp)
        return tuple(said)

    def refresh_hz(self, monitor: Any) -> float:
        """Refresh rate of a glfw monitor, Hz, in whole Hz where no more is known; 0 = not known."""
        name = os.fsdecode(glfw.get_monitor_name(monitor))
        outputs = self._server.outputs() if self._server else ()
        exact = [output.refresh_hz for output in outputs if output.name == name and output.refresh_hz]
        return exact[0] if exact else float(glfw.get_video_mode(monitor).refresh_rate)

    def close(self) -> None:
        """Let the screen saver go on; safe to call twice."""
        if self._server:
            self._server.close()


def on_wayland() -> bool:
    """Whether the session is Wayland's, its X server included."""
    return os.environ.get("XDG_SESSION_TYPE") == "wayland" or bool(os.environ.get("WAYLAND_DISPLAY"))


def output_warnings(name: str, outputs: Sequence[Output]) -> list[str]:
    """Changes that an output makes to its picture, given all lit outputs, in words."""
    said = []
    for own in (output for output in outputs if output.name == name):
        if own.scaled:
            said.append(f"{name}: its picture is scaled by the X server: xrandr --output {name} --scale 1x1")
        if own.turned:
            said.append(f"{name}: its picture is turned or mirrored: xrandr --output {name} --rotate normal")
        if own.panned:
            said.append(f"{name}: its picture follows the mouse: xrandr --output {name} --panning 0x0")
        said += [
            f"{name}: {other.name} shows the same part of the desktop (mirrored outputs)"
            for other in outputs
            if other.name != name and _overlap(own, other)
        ]
    return said


def ramp_warnings(name: str, ramp: Sequence[Sequence[float]]) -> list[str]:
    """Changes to greys by the ramps of red, green and blue (each 0..1 over the codes), in words."""
    linear = np.linspace(0, 1, len(ramp[0]))
    worst = max(float(np.max(np.abs(np.asarray(colour) - linear))) for colour in ramp)
    if worst <= _RAMP_TOLERANCE:
        return []
    return [
        f"{name}: its gamma ramp changes greys by up to {worst:.0%} (night mode, colour profile?): "
        "turn that off, or measure the LCD's response with it on"
    ]


def _overlap(one: Output, other: Output) -> bool:
    columns = min(one.x + one.columns, other.x + other.columns) - max(one.x, other.x)
    rows = min(one.y + one.rows, other.y + other.rows) - max(one.y, other.y)
    return columns > 0 and rows > 0


def _gamma_ramp(monitor: Any) -> tuple[Sequence[float], ...]:
    """Red, green, blue; empty where the monitor has no ramp."""
    try:
        ramp: Any = glfw.get_gamma_ramp(monitor)
    except (glfw.GLFWError, ValueError):  # ValueError: glfw's pointer to the ramp is null
        return ()
    return (ramp.red, ramp.green, ramp.blue) if len(ramp.red) > 1 else ()
