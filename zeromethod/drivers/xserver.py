"""The X server, asked directly for what glfw does not report: outputs, power saving and its inhibition.

Declarations follow the headers Xlib.h, Xrandr.h, dpms.h and scrnsaver.h.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import POINTER, Structure, byref, c_char_p, c_int, c_ubyte, c_uint, c_ulong, c_ushort, c_void_p
from dataclasses import dataclass
from functools import cache
from typing import Any

from zeromethod.errors import InputError
from zeromethod.worker import call_within

PATIENCE_S = 5.0
"""How long the server is waited for."""

_INTERLACED, _DOUBLE_SCAN = 0x10, 0x20
_ROTATE_0 = 1
_ONE = 0x10000
_IDENTITY = (_ONE, 0, 0, 0, _ONE, 0, 0, 0, _ONE)
_FORCE_RESET = 0
_DPMS_STATES = ("", "standby", "suspend", "off")


@dataclass(frozen=True, slots=True)
class Output:
    """A lit output. x, y, columns, rows: the part of the desktop that it shows, px; refresh_hz: exact, Hz.

    turned: rotated or reflected. scaled: by a transform. panned: the part moves with the mouse pointer.
    """

    name: str
    x: int
    y: int
    columns: int
    rows: int
    refresh_hz: float
    turned: bool = False
    scaled: bool = False
    panned: bool = False


class _Mode(Structure):
    _fields_ = (
        ("id", c_ulong),
        ("size", c_uint * 2),
        ("dot_clock", c_ulong),
        ("h_sync", c_uint * 2),
        ("h_total", c_uint),
        ("h_skew", c_uint),
        ("v_sync", c_uint * 2),
        ("v_total", c_uint),
        ("name", c_char_p),
        ("name_length", c_uint),
        ("flags", c_ulong),
    )


class _Resources(Structure):
    _fields_ = (
        ("times", c_ulong * 2),
        ("crtc_count", c_int),
        ("crtcs", POINTER(c_ulong)),
        ("output_count", c_int),
        ("outputs", POINTER(c_ulong)),
        ("mode_count", c_int),
        ("modes", POINTER(_Mode)),
    )


class _Crtc(Structure):
    _fields_ = (
        ("time", c_ulong),
        ("x", c_int),
        ("y", c_int),
        ("width", c_uint),
        ("height", c_uint),
        ("mode", c_ulong),
        ("rotation", c_ushort),
        ("output_count", c_int),
        ("outputs", POINTER(c_ulong)),
    )


class _OutputHead(Structure):
    _fields_ = (("time", c_ulong), ("crtc", c_ulong), ("name", c_char_p))


class _Transform(Structure):
    _fields_ = (
        ("pending", c_int * 9),
        ("pending_filter", c_char_p),
        ("pending_count", c_int),
        ("pending_parameters", c_void_p),
        ("current", c_int * 9),
    )


class _Panning(Structure):
    _fields_ = (("time", c_ulong), ("left_top", c_uint * 2), ("size", c_uint * 2))


_ErrorHandler = ctypes.CFUNCTYPE(c_int, c_void_p, c_void_p)
_ignore_error = _ErrorHandler(lambda _server, _error: 0)


_LIBRARIES: dict[str, dict[str, tuple[Any, tuple[Any, ...]]]] = {
    "libX11.so.6": {
        "XOpenDisplay": (c_void_p, (c_char_p,)),
        "XCloseDisplay": (c_int, (c_void_p,)),
        "XDefaultRootWindow": (c_ulong, (c_void_p,)),
        "XFree": (c_int, (c_void_p,)),
        "XSync": (c_int, (c_void_p, c_int)),
        "XSetErrorHandler": (c_void_p, (c_void_p,)),
        "XForceScreenSaver": (c_int, (c_void_p, c_int)),
    },
    "libXrandr.so.2": {
        "XRRGetScreenResourcesCurrent": (POINTER(_Resources), (c_void_p, c_ulong)),
        "XRRFreeScreenResources": (None, (c_void_p,)),
        "XRRGetCrtcInfo": (POINTER(_Crtc), (c_void_p, c_void_p, c_ulong)),
        "XRRFreeCrtcInfo": (None, (c_void_p,)),
        "XRRGetOutputInfo": (POINTER(_OutputHead), (c_void_p, c_void_p, c_ulong)),
        "XRRFreeOutputInfo": (None, (c_void_p,)),
        "XRRGetCrtcTransform": (c_int, (c_void_p, c_ulong, POINTER(POINTER(_Transform)))),
        "XRRGetPanning": (POINTER(_Panning), (c_void_p, c_void_p, c_ulong)),
        "XRRFreePanning": (None, (c_void_p,)),
    },
    "libXext.so.6": {
        "DPMSQueryExtension": (c_int, (c_void_p, POINTER(c_int), POINTER(c_int))),
        "DPMSInfo": (c_int, (c_void_p, POINTER(c_ushort), POINTER(c_ubyte))),
        "DPMSForceLevel": (c_int, (c_void_p, c_ushort)),
    },
    "libXss.so.1": {
        "XScreenSaverQueryExtension": (c_int, (c_void_p, POINTER(c_int), POINTER(c_int))),
        "XScreenSaverSuspend": (None, (c_void_p, c_int)),
    },
}
"""Functions with the types of their results and arguments."""


@cache
def _library(name: str) -> ctypes.CDLL | None:
    """Library of the table; None where it is not installed."""
    try:
        library = ctypes.CDLL(name)
    except OSError:
        return None
    for function, (result, arguments) in _LIBRARIES[name].items():
        getattr(library, function).restype = result
        getattr(library, function).argtypes = arguments
    return library


@contextmanager
def _freed(found: Any, free: Callable[[Any], object]) -> Iterator[Any]:
    """Contents of a pointer that the server gave, freed at the end; None for a null pointer."""
    try:
        yield found.contents if found else None
    finally:
        if found:
            free(found)


class XServer:
    """A connection of its own to the server that DISPLAY names; for one thread at a time.

    Power saving stays off until the connection ends, however the process ends.
    """

    def __init__(self) -> None:
        """Connect; OSError without libX11 or server, InputError when it does not answer in time."""
        x11 = _library("libX11.so.6")
        if x11 is None:
            raise OSError("no libX11")
        self._x11 = x11
        try:  # a server that accepts the connection and says nothing would be waited for without end
            self._server: int | None = call_within(PATIENCE_S, lambda: x11.XOpenDisplay(None), "X server")
        except TimeoutError:
            name = os.environ.get("DISPLAY", "")
            raise InputError(
                f"display window: the X server {name} does not answer within {PATIENCE_S:g} s"
            ) from None
        if not self._server:
            raise OSError("no X server")

    def outputs(self) -> tuple[Output, ...]:
        """Lit outputs, empty where the server does not know (no RandR, no libXrandr)."""
        randr = _library("libXrandr.so.2")
        if randr is None:
            return ()
        with self._errors_ignored():
            found = randr.XRRGetScreenResourcesCurrent(
                self._server, self._x11.XDefaultRootWindow(self._server)
            )
            with _freed(found, randr.XRRFreeScreenResources) as resources:
                crtcs = resources.crtcs[: resources.crtc_count] if resources else ()
                return tuple(one for crtc in crtcs for one in self._outputs_of(randr, resources, crtc))

    def asleep(self) -> str:
        """Power state of the monitors in words ("standby", "suspend", "off"); "" when lit or not known."""
        state = self._power_state()
        return _DPMS_STATES[state] if state is not None and state < len(_DPMS_STATES) else ""

    def keep_awake(self) -> bool:
        """Light the monitors, turn screen saver and power saving off; False where the server cannot."""
        with self._errors_ignored():
            self._x11.XForceScreenSaver(self._server, _FORCE_RESET)
            if (dpms := _library("libXext.so.6")) and self._power_state():
                dpms.DPMSForceLevel(self._server, 0)
            saver = _library("libXss.so.1")
            if saver is None or not saver.XScreenSaverQueryExtension(
                self._server, byref(c_int()), byref(c_int())
            ):
                return False
            saver.XScreenSaverSuspend(self._server, 1)
            return True

    def close(self) -> None:
        """End the connection; safe to call twice."""
        server, self._server = self._server, None
        if server:
            self._x11.XCloseDisplay(server)

    def _power_state(self) -> int | None:
        """DPMS state (0 = lit), None where power saving is not known or not enabled."""
        dpms = _library("libXext.so.6")
        if dpms is None:
            return None
        with self._errors_ignored():
            if not dpms.DPMSQueryExtension(self._server, byref(c_int()), byref(c_int())):
                return None
            state, enabled = c_ushort(), c_ubyte()
            dpms.DPMSInfo(self._server, byref(state), byref(enabled))
        return state.value if enabled.value else None

    def _outputs_of(self, randr: ctypes.CDLL, resources: _Resources, crtc: int) -> list[Output]:
        asked = self._server, byref(resources)
        with _freed(randr.XRRGetCrtcInfo(*asked, crtc), randr.XRRFreeCrtcInfo) as place:
            if not (place and place.mode):
                return []
            with _freed(randr.XRRGetPanning(*asked, crtc), randr.XRRFreePanning) as panning:
                panned = bool(panning and any(panning.size))
            part = place.x, place.y, place.width, place.height
            refresh_hz, turned = _refresh_hz(resources, place.mode), place.rotation != _ROTATE_0
            figures = *part, refresh_hz, turned, self._scaled(randr, crtc), panned
            outputs = []
            for output in place.outputs[: place.output_count]:
                with _freed(randr.XRRGetOutputInfo(*asked, output), randr.XRRFreeOutputInfo) as info:
                    outputs.append(Output(os.fsdecode(info.name) if info else "", *figures))
            return outputs

    def _scaled(self, randr: ctypes.CDLL, crtc: int) -> bool:
        found = POINTER(_Transform)()
        known = randr.XRRGetCrtcTransform(self._server, crtc, byref(found))
        with _freed(found if known else None, self._x11.XFree) as transform:
            return transform is not None and tuple(transform.current) != _IDENTITY

    @contextmanager
    def _errors_ignored(self) -> Iterator[None]:
        """Answer errors (an output that has just gone) with nothing; Xlib's own answer ends the process."""
        before = self._x11.XSetErrorHandler(_ignore_error)
        try:
            yield
            self._x11.XSync(self._server, 0)
        finally:
            self._x11.XSetErrorHandler(before)


def _refresh_hz(resources: _Resources, mode_id: int) -> float:
    """Refresh rate of a mode, Hz; 0 when it is not known."""
    for mode in resources.modes[: resources.mode_count]:
        lines = (
            mode.v_total * (2 if mode.flags & _DOUBLE_SCAN else 1) / (2 if mode.flags & _INTERLACED else 1)
        )
        if mode.id == mode_id and lines and mode.h_total:
            return float(mode.dot_clock / (mode.h_total * lines))
    return 0.0
