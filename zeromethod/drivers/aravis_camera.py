"""GigE Vision and USB3 Vision cameras of any maker through Aravis."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Image
from zeromethod.clock import HostClock
from zeromethod.devices.protocols import CameraLost, Frame, gives_buffers
from zeromethod.drivers.aravis_library import SUCCESS, Aravis, AravisError, library
from zeromethod.drivers.genicam import FeatureError, GenICamSource, Settings, Value
from zeromethod.drivers.grabbing import POLL_S, GrabbedCamera
from zeromethod.drivers.not_opened import in_words
from zeromethod.errors import InputError

_OPENING_S = 15.0
_BUFFERS = 4
"""One is filled while one is read; the others take up what comes while the thread waits for its turn."""


@dataclass(repr=False, eq=False)
class AravisCamera(Settings, GrabbedCamera):
    """A `Camera` that speaks GigE Vision or USB3 Vision.

    address: IP address or Aravis' name of it; the first found where it is empty. InputError (one line)
    without Aravis or camera, or for a value that it refuses. Times are the device's, mapped onto the host's
    clock.
    """

    address: str = ""

    def __post_init__(self) -> None:
        GrabbedCamera.__init__(self, "aravis", lambda: _AravisSource(self.address, self), _OPENING_S)


def found() -> list[tuple[str, str]]:
    """Address and name of every camera; takes about a second."""
    aravis = library()
    aravis.update_device_list()
    indices = range(aravis.get_n_devices())
    return [(aravis.get_device_address(i).decode(), aravis.get_device_id(i).decode()) for i in indices]


class _AravisFeatures:
    """A device's features as `Features`."""

    def __init__(self, aravis: Aravis, device: int) -> None:
        self._aravis = aravis
        self._device = device

    def _do(self, name: str, feature: str, *arguments: Any) -> Any:
        try:
            return getattr(self._aravis, f"device_{name}")(self._device, feature.encode(), *arguments)
        except AravisError as error:
            raise FeatureError(str(error)) from error

    def _kind(self, name: str) -> str:
        kind = self._aravis.kind(self._device, name)
        return "string" if kind == "enumeration" else kind

    def available(self, name: str) -> bool:
        try:
            return bool(self._do("is_feature_available", name))
        except FeatureError:
            return False

    def get(self, name: str) -> Value:
        value = self._do(f"get_{self._kind(name)}_feature_value", name)
        return value.decode() if isinstance(value, bytes) else value

    def put(self, name: str, value: Value) -> None:
        kind = self._kind(name)
        if (kind == "string") != isinstance(value, str) or not kind:
            raise FeatureError(f"{name} is not set by {type(value).__name__}")
        plain = value.encode() if isinstance(value, str) else round(value) if kind == "integer" else value
        self._do(f"set_{kind}_feature_value", name, plain)

    def execute(self, name: str) -> None:
        self._do("execute_command", name)

    def bounds(self, name: str) -> tuple[float, float] | None:
        kind = self._kind(name)
        if kind not in ("float", "integer"):
            return None
        number = ctypes.c_double if kind == "float" else ctypes.c_int64
        low, high = number(), number()
        self._do(f"get_{kind}_feature_bounds", name, ctypes.byref(low), ctypes.byref(high))
        return low.value, high.value

    def choices(self, name: str) -> Sequence[str]:
        if self._aravis.kind(self._device, name) != "enumeration":
            return ()
        count = ctypes.c_uint()
        values = self._do("dup_available_enumeration_feature_values_as_strings", name, ctypes.byref(count))
        texts = ctypes.cast(values, ctypes.POINTER(ctypes.c_char_p))
        names = [(texts[i] or b"").decode() for i in range(count.value)]
        self._aravis.free(values)
        return names


class _AravisSource(GenICamSource):
    """An opened camera that streams."""

    def __init__(self, address: str, settings: Settings) -> None:
        self._aravis = aravis = library()
        self._clock = HostClock()
        self._stream = 0
        self._control_lost = False
        self._last_id: int | None = None
        self._camera = self._opened(address)
        try:
            device = aravis.camera_get_device(self._camera)
            self._handler = aravis.on_signal(device, "control-lost", self._when_lost)
            self._features = _AravisFeatures(aravis, device)
            self._set_up(self._features, settings, tick_ns=1.0)  # Aravis has turned ticks into nanoseconds
            self._dtype = np.dtype(np.uint8 if self.bits == 8 else np.uint16)
            self._stream = aravis.camera_create_stream(self._camera, None, None)
            payload = aravis.camera_get_payload(self._camera)
            for _ in range(_BUFFERS):
                aravis.stream_push_buffer(self._stream, aravis.buffer_new_allocate(payload))
            aravis.camera_start_acquisition(self._camera)
        except BaseException:
            self.close()
            raise

    def _opened(self, address: str) -> int:
        if not address:
            # by its address: by no name at all, a camera on another interface may be taken
            cameras = found()
            if not cameras:
                raise InputError("camera.address: '': no GigE Vision or USB3 Vision camera was found")
            address = cameras[0][0] or cameras[0][1]
        try:
            camera: int = self._aravis.camera_new(address.encode())
        except AravisError as error:
            raise InputError(
                f"camera.address: {address!r}: cannot be opened: {in_words(str(error))}"
            ) from error
        return camera

    def _when_lost(self) -> None:
        self._control_lost = True

    @gives_buffers
    def grab(self) -> Frame | None:
        """Newest frame, or None when none came in a moment; raises CameraLost when its control is lost."""
        if self._control_lost:
            raise CameraLost("it no longer answers (control lost)")
        if self._trigger_due():
            self._features.execute("TriggerSoftware")
        buffer = self._aravis.stream_timeout_pop_buffer(self._stream, round(1e6 * POLL_S))
        if not buffer:
            time.sleep(1e-3)  # a stream that is broken does not wait
            return None
        received_ns = self._clock.now_ns()
        while newer := self._aravis.stream_try_pop_buffer(self._stream):
            self._aravis.stream_push_buffer(self._stream, buffer)
            buffer = newer
        try:
            return self._read(buffer, received_ns)
        finally:
            self._aravis.stream_push_buffer(self._stream, buffer)

    def _read(self, buffer: int, received_ns: int) -> Frame | None:
        aravis = self._aravis
        if aravis.buffer_get_status(buffer) != SUCCESS:
            return None
        self._check_shape((aravis.buffer_get_image_height(buffer), aravis.buffer_get_image_width(buffer)))
        number = aravis.buffer_get_frame_id(buffer)
        # identities wrap round (16 bits in old cameras) and start again with the stream
        step = 1 if self._last_id is None else number - self._last_id
        self._last_id = number
        dropped = step - 1 if 1 <= step < 1000 else 0
        return self._frame(self._copy(buffer), received_ns, aravis.buffer_get_timestamp(buffer), dropped)

    def _copy(self, buffer: int) -> Image:
        size = ctypes.c_size_t()
        data = self._aravis.buffer_get_data(buffer, ctypes.byref(size))
        needed = self.shape[0] * self.shape[1] * self._dtype.itemsize
        if size.value < needed:
            raise CameraLost(f"its frames have {size.value} bytes instead of {needed}")
        raw = np.ctypeslib.as_array(ctypes.cast(data, ctypes.POINTER(ctypes.c_uint8)), (needed,))
        return raw.view(self._dtype).reshape(self.shape).copy()

    def close(self) -> None:
        """Stop and release the device."""
        if self._stream:
            if not self._control_lost:
                self._aravis.camera_stop_acquisition(self._camera)
            self._aravis.release(self._stream)
        self._aravis.release(self._camera)
