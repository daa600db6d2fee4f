"""The X server, asked directly for what glfw does not report: outputs, power saving and its inhibition.

Declarations follow the headers Xlib.h, Xrandr.h, dpms.h and scrnsaver.h.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
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


def _library(name: str, functions: dict[str, tuple[Any, tuple[Any, ...]]]) -> ctypes.CDLL:
    """Library with the result and argument types of its functions declared; OSError when missing."""
    library = ctypes.CDLL(name)
    for function, (result, arguments) in functions.items():
        getattr(library, function).restype = result
        getattr(library, function).argtypes = arguments
    return library


@cache
def _x11() -> ctypes.CDLL:
    return _library(
        "libX11.so.6",
        {
            "XOpenDisplay": (c_void_p, (c_char_p,)),
            "XCloseDisplay": (c_int, (c_void_p,)),
            "XDefaultRootWindow": (c_ulong, (c_void_p,)),
            "XFree": (c_int, (c_void_p,)),
            "XSync": (c_int, (c_void_p, c_int)),
            "XSetErrorHandler": (c_void_p, (c_void_p,)),
            "XForceScreenSaver": (c_int, (c_void_p, c_int)),
        },
    )


@cache
def _xrandr() -> ctypes.CDLL:
    crtc, resources, output = POINTER(_Crtc), POINTER(_Resources), POINTER(_OutputHead)
    return _library(
        "libXrandr.so.2",
        {
            "XRRGetScreenResourcesCurrent": (resources, (c_void_p, c_ulong)),
            "XRRFreeScreenResources": (None, (resources,)),
            "XRRGetCrtcInfo": (crtc, (c_void_p, resources, c_ulong)),
            "XRRFreeCrtcInfo": (None, (crtc,)),
            "XRRGetOutputInfo": (output, (c_void_p, resources, c_ulong)),
            "XRRFreeOutputInfo": (None, (output,)),
            "XRRGetCrtcTransform": (c_int, (c_void_p, c_ulong, POINTER(POINTER(_Transform)))),
            "XRRGetPanning": (POINTER(_Panning), (c_void_p, resources, c_ulong)),
            "XRRFreePanning": (None, (POINTER(_Panning),)),
        },
    )


@cache
def _dpms() -> ctypes.CDLL:
    two = (c_void_p, POINTER(c_int), POINTER(c_int))
    return _library(
        "libXext.so.6",
        {
            "DPMSQueryExtension": (c_int, two),
            "DPMSInfo": (c_int, (c_void_p, POINTER(c_ushort), POINTER(c_ubyte))),
            "DPMSForceLevel": (c_int, (c_void_p, c_ushort)),
        },
    )


@cache
def _screen_saver() -> ctypes.CDLL:
    return _library(
        "libXss.so.1",
        {
            "XScreenSaverQueryExtension": (c_int, (c_void_p, POINTER(c_int), POINTER(c_int))),
            "XScreenSaverSuspend": (None, (c_void_p, c_int)),
        },
    )


class XServer:
    """A connection of its own to the server that DISPLAY names; for one thread at a time.

    Power saving stays off until the connection ends, however the process ends.
    """

    def __init__(self) -> None:
        """Connect; OSError without libX11 or server, InputError when it does not answer in time."""
        self._x11 = _x11()
        try:  # a server that accepts the connection and says nothing would be waited for without end
            self._server: int | None = call_within(
                PATIENCE_S, lambda: self._x11.XOpenDisplay(None), "X server"
            )
        except TimeoutError:
            name = os.environ.get("DISPLAY", "")
            raise InputError(
                f"display window: the X server {name} does not answer within {PATIENCE_S:g} s"
            ) from None
        if not self._server:
            raise OSError("no X server")

    def outputs(self) -> tuple[Output, ...]:
        """Lit outputs, empty where the server does not know (no RandR, no libXrandr)."""
        try:
            randr = _xrandr()
        except OSError:
            return ()
        with self._errors_ignored():
            root = self._x11.XDefaultRootWindow(self._server)
            resources = randr.XRRGetScreenResourcesCurrent(self._server, root)
            if not resources:
                return ()
            try:
                crtcs = resources.contents.crtcs[: resources.contents.crtc_count]
                return tuple(output for crtc in crtcs for output in self._outputs_of(randr, resources, crtc))
            finally:
                randr.XRRFreeScreenResources(resources)

    def asleep(self) -> str:
        """Power state of the monitors in words ("standby", "suspend", "off"); "" when lit or not known."""
        state = self._power_state()
        return _DPMS_STATES[state] if state is not None and state < len(_DPMS_STATES) else ""

    def keep_awake(self) -> bool:
        """Light the monitors, turn screen saver and power saving off; False where the server cannot."""
        with self._errors_ignored():
            self._x11.XForceScreenSaver(self._server, _FORCE_RESET)
            if self._power_state():
                _dpms().DPMSForceLevel(self._server, 0)
            try:
                saver = _screen_saver()
            except OSError:
                return False
            if not saver.XScreenSaverQueryExtension(self._server, byref(c_int()), byref(c_int())):
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
        try:
            dpms = _dpms()
        except OSError:
            return None
        with self._errors_ignored():
            if not dpms.DPMSQueryExtension(self._server, byref(c_int()), byref(c_int())):
                return None
            state, enabled = c_ushort(), c_ubyte()
            dpms.DPMSInfo(self._server, byref(state), byref(enabled))
        return state.value if enabled.value else None

    def _outputs_of(self, randr: ctypes.CDLL, resources: Any, crtc: int) -> list[Output]:
        info = randr.XRRGetCrtcInfo(self._server, resources, crtc)
        if not info:
            return []
        try:
            if not info.contents.mode:
                return []
            place = info.contents
            turned = place.rotation != _ROTATE_0
            refresh_hz = _refresh_hz(resources.contents, place.mode)
            scaled, panned = self._scaled(randr, crtc), self._panned(randr, resources, crtc)
            part = place.x, place.y, place.width, place.height
            names = [self._name(randr, resources, place.outputs[i]) for i in range(place.output_count)]
            return [Output(name, *part, refresh_hz, turned, scaled, panned) for name in names]
        finally:
            randr.XRRFreeCrtcInfo(info)

    def _name(self, randr: ctypes.CDLL, resources: Any, output: int) -> str:
        info = randr.XRRGetOutputInfo(self._server, resources, output)
        if not info:
            return ""
        try:
            return os.fsdecode(info.contents.name)
        finally:
            randr.XRRFreeOutputInfo(info)

    def _scaled(self, randr: ctypes.CDLL, crtc: int) -> bool:
        transform = POINTER(_Transform)()
        if not randr.XRRGetCrtcTransform(self._server, crtc, byref(transform)) or not transform:
            return False
        try:
            return tuple(transform.contents.current) != _IDENTITY
        finally:
            self._x11.XFree(transform)

    def _panned(self, randr: ctypes.CDLL, resources: Any, crtc: int) -> bool:
        panning = randr.XRRGetPanning(self._server, resources, crtc)
        if not panning:
            return False
        try:
            return any(panning.contents.size)
        finally:
            randr.XRRFreePanning(panning)

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
