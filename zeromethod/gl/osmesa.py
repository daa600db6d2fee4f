"""A GL context of Mesa's off-screen library OSMesa, inside the process, for machines without EGL."""

from __future__ import annotations

import ctypes
from functools import cache
from importlib import metadata
from pathlib import Path

_FORMAT, _RGBA = 0x22, 0x1908
_DEPTH_BITS, _STENCIL_BITS = 0x30, 0x31
_PROFILE, _CORE_PROFILE = 0x33, 0x34
_MAJOR, _MINOR = 0x36, 0x37
_UNSIGNED_BYTE = 0x1401

_SYSTEM_NAMES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
_WHEEL = "lavavu-osmesa"
_WHEEL_ORDER = ("tinfo", "ffi", "pcre2", "selinux", "zstd", "drm", "LLVM", "glapi", "OSMesa")
"""The wheel's libraries find each other only when they are loaded in this order, symbols global."""

_EDGE_PX = 4
_SCREEN = ctypes.create_string_buffer(_EDGE_PX * _EDGE_PX * 4)
"""Framebuffer 0 of every context; nobody draws there, but OSMesa may write to it at any flush."""


class OSMesaError(RuntimeError):
    """OSMesa is not installed or refuses a context; the message is the reason, on one line."""


def _from_wheel() -> ctypes.CDLL:
    """OSMesa of the wheel; raises OSError when the wheel or one of its libraries is missing."""
    try:
        files = metadata.distribution(_WHEEL).files or []
    except metadata.PackageNotFoundError as error:
        raise OSError(f"wheel {_WHEEL} is not installed") from error
    paths = [Path(str(file.locate())) for file in files if ".so" in file.name]
    library = None
    for stem in _WHEEL_ORDER:
        for path in sorted(p for p in paths if p.name.startswith(f"lib{stem}")):
            library = ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    if library is None or not hasattr(library, "OSMesaCreateContextAttribs"):
        raise OSError(f"wheel {_WHEEL} contains no libOSMesa")
    return library


def _declare(library: ctypes.CDLL) -> ctypes.CDLL:
    handle, number = ctypes.c_void_p, ctypes.c_int
    library.OSMesaCreateContextAttribs.argtypes = [ctypes.POINTER(number), handle]
    library.OSMesaCreateContextAttribs.restype = handle
    library.OSMesaMakeCurrent.argtypes = [handle, handle, ctypes.c_uint, number, number]
    library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
    library.OSMesaDestroyContext.argtypes = [handle]
    library.OSMesaDestroyContext.restype = None
    library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
    library.OSMesaGetProcAddress.restype = handle
    return library


@cache
def load_osmesa() -> ctypes.CDLL:
    """Load the system's OSMesa library, else the wheel's, once. Raises OSMesaError."""
    reasons = []
    for name in _SYSTEM_NAMES:
        try:
            return _declare(ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL))
        except (OSError, AttributeError) as error:
            reasons.append(str(error))
    try:
        return _declare(_from_wheel())
    except (OSError, AttributeError) as error:
        reasons.append(str(error))
    raise OSMesaError("; ".join(reasons))


class OSMesaContext:
    """Core-profile context (3.3 or newer) of OSMesa. Raises OSMesaError."""

    def __init__(self) -> None:
        self._library = load_osmesa()
        wanted = [_FORMAT, _RGBA, _DEPTH_BITS, 0, _STENCIL_BITS, 0]
        wanted += [_PROFILE, _CORE_PROFILE, _MAJOR, 3, _MINOR, 3, 0]
        attributes = (ctypes.c_int * len(wanted))(*wanted)
        self._handle: int | None = self._library.OSMesaCreateContextAttribs(attributes, None)
        if not self._handle:
            raise OSMesaError("OSMesa gives no OpenGL 3.3 core context")

    def bind(self) -> None:
        """Make it current in this thread."""
        if not self._library.OSMesaMakeCurrent(self._handle, _SCREEN, _UNSIGNED_BYTE, _EDGE_PX, _EDGE_PX):
            raise OSMesaError("OSMesaMakeCurrent failed")

    def unbind(self) -> None:
        """Make no OSMesa context current in this thread."""
        self._library.OSMesaMakeCurrent(None, None, _UNSIGNED_BYTE, 0, 0)

    def address(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def destroy(self) -> None:
        """Free the context; it is not current (OSMesa does not check that)."""
        self._library.OSMesaDestroyContext(self._handle)
        self._handle = None
