"""Aravis' C library and the few of its functions that are used here.

Through ctypes: it needs the system's library alone (Debian: libaravis-0.8-0), in any virtual environment,
and its calls let other threads run.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import POINTER, c_bool, c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_uint64, c_void_p
from functools import cache
from typing import Any

from zeromethod.errors import InputError

LIBRARY = "libaravis-0.8.so.0"
INSTALL = "install the system's Aravis library (Debian, Ubuntu: apt install libaravis-0.8-0)"

SUCCESS = 0
"""Status of a buffer that holds a whole frame."""


class AravisError(Exception):
    """An error that Aravis reports, in its words."""


class _GError(ctypes.Structure):
    _fields_ = (("domain", ctypes.c_uint32), ("code", c_int), ("message", c_char_p))


_ERROR = POINTER(POINTER(_GError))
_OUT_INT, _OUT_FLOAT, _OUT_COUNT = POINTER(c_int64), POINTER(c_double), POINTER(c_uint)

_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_update_device_list": (None, ()),
    "arv_get_n_devices": (c_uint, ()),
    "arv_get_device_id": (c_char_p, (c_uint,)),
    "arv_get_device_address": (c_char_p, (c_uint,)),
    "arv_camera_get_device": (c_void_p, (c_void_p,)),
    "arv_device_get_feature": (c_void_p, (c_void_p, c_char_p)),
    "arv_stream_push_buffer": (None, (c_void_p, c_void_p)),
    "arv_stream_timeout_pop_buffer": (c_void_p, (c_void_p, c_uint64)),
    "arv_stream_try_pop_buffer": (c_void_p, (c_void_p,)),
    "arv_buffer_new_allocate": (c_void_p, (c_size_t,)),
    "arv_buffer_get_status": (c_int, (c_void_p,)),
    "arv_buffer_get_data": (c_void_p, (c_void_p, POINTER(c_size_t))),
    "arv_buffer_get_image_width": (c_int, (c_void_p,)),
    "arv_buffer_get_image_height": (c_int, (c_void_p,)),
    "arv_buffer_get_timestamp": (c_uint64, (c_void_p,)),
    "arv_buffer_get_frame_id": (c_uint64, (c_void_p,)),
}
# These take a place for an error as their last argument.
_FALLIBLE: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_camera_new": (c_void_p, (c_char_p,)),
    "arv_camera_get_payload": (c_uint, (c_void_p,)),
    "arv_camera_create_stream": (c_void_p, (c_void_p, c_void_p, c_void_p)),
    "arv_camera_start_acquisition": (None, (c_void_p,)),
    "arv_camera_stop_acquisition": (None, (c_void_p,)),
    "arv_device_is_feature_available": (c_bool, (c_void_p, c_char_p)),
    "arv_device_execute_command": (None, (c_void_p, c_char_p)),
    "arv_device_get_integer_feature_value": (c_int64, (c_void_p, c_char_p)),
    "arv_device_get_float_feature_value": (c_double, (c_void_p, c_char_p)),
    "arv_device_get_string_feature_value": (c_char_p, (c_void_p, c_char_p)),
    "arv_device_get_boolean_feature_value": (c_bool, (c_void_p, c_char_p)),
    "arv_device_set_integer_feature_value": (None, (c_void_p, c_char_p, c_int64)),
    "arv_device_set_float_feature_value": (None, (c_void_p, c_char_p, c_double)),
    "arv_device_set_string_feature_value": (None, (c_void_p, c_char_p, c_char_p)),
    "arv_device_set_boolean_feature_value": (None, (c_void_p, c_char_p, c_bool)),
    "arv_device_get_integer_feature_bounds": (None, (c_void_p, c_char_p, _OUT_INT, _OUT_INT)),
    "arv_device_get_float_feature_bounds": (None, (c_void_p, c_char_p, _OUT_FLOAT, _OUT_FLOAT)),
    "arv_device_dup_available_enumeration_feature_values_as_strings": (
        c_void_p,
        (c_void_p, c_char_p, _OUT_COUNT),
    ),
}
_KINDS = ("enumeration", "float", "integer", "boolean", "string")
"""Of features, by GObject's types; an enumeration is an integer too, so it is asked for first."""
_SIGNAL = ctypes.CFUNCTYPE(None, c_void_p, c_void_p)


@cache
def library() -> Aravis:
    """Loads Aravis; InputError (one line, with what to install) where it is not there."""
    try:
        return Aravis(ctypes.CDLL(LIBRARY))
    except OSError as error:
        raise InputError(f"camera.driver: 'aravis': needs {LIBRARY}: {INSTALL}") from error


def _declared(library: ctypes.CDLL, name: str, result: Any, arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """Function of a library with the types of its result and arguments."""
    function = getattr(library, name)
    function.restype, function.argtypes = result, arguments
    return function  # type: ignore[no-any-return]


class Aravis:
    """The library's functions by name; those that can fail raise AravisError."""

    def __init__(self, loaded: ctypes.CDLL) -> None:
        glib, gobject = ctypes.CDLL("libglib-2.0.so.0"), ctypes.CDLL("libgobject-2.0.so.0")
        self._free_error = _declared(glib, "g_error_free", None, (c_void_p,))
        self.free = _declared(glib, "g_free", None, (c_void_p,))
        """Frees what the library allocated, by its address."""
        self.release = _declared(gobject, "g_object_unref", None, (c_void_p,))
        """Releases a reference to an object."""
        self._is_a = _declared(gobject, "g_type_check_instance_is_a", c_int, (c_void_p, c_size_t))
        connecting = c_void_p, c_char_p, _SIGNAL, c_void_p, c_void_p, c_int
        self._connect = _declared(gobject, "g_signal_connect_data", ctypes.c_ulong, connecting)
        self._functions = {name: _declared(loaded, name, *types) for name, types in _FUNCTIONS.items()}
        for name, (result, arguments) in _FALLIBLE.items():
            self._functions[name] = self._checked(_declared(loaded, name, result, (*arguments, _ERROR)))
        self._types = {kind: _declared(loaded, f"arv_gc_{kind}_get_type", c_size_t, ())() for kind in _KINDS}

    def _checked(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            error = POINTER(_GError)()
            result = function(*arguments, ctypes.byref(error))
            if error:
                message = (error.contents.message or b"").decode(errors="replace")
                self._free_error(error)
                raise AravisError(" ".join(message.split()) or "failed without a message")
            return result

        return call

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Function of the library by its name without `arv_`."""
        try:
            return self._functions[f"arv_{name}"]
        except KeyError:
            raise AttributeError(name) from None

    def on_signal(self, thing: int, signal: str, act: Callable[[], None]) -> object:
        """Call `act`, in a thread of the library, on a signal; keep what is returned until it is released."""
        handler = _SIGNAL(lambda _thing, _data: act())
        self._connect(thing, signal.encode(), handler, None, None, 0)
        return handler

    def kind(self, device: int, feature: str) -> str:
        """Type of a feature: float, integer, boolean, enumeration or string; "" for others."""
        node = self.device_get_feature(device, feature.encode())
        return next((kind for kind in _KINDS if node and self._is_a(node, self._types[kind])), "")
