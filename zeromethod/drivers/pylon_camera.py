"""Basler cameras through pypylon (extra `pylon`)."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from zeromethod.clock import HostClock
from zeromethod.devices.protocols import CameraLost, Frame, gives_buffers
from zeromethod.drivers.genicam import FeatureError, GenICamSource, Settings, Value
from zeromethod.drivers.grabbing import POLL_S, GrabbedCamera
from zeromethod.drivers.not_opened import in_words
from zeromethod.errors import InputError

_OPENING_S = 15.0


@dataclass(repr=False, eq=False)
class PylonCamera(Settings, GrabbedCamera):
    """A `Camera` of Basler: GigE, USB3, or pylon's emulator (environment variable PYLON_CAMEMU).

    serial: which; the first found where it is empty. InputError (one line) without pypylon or camera, or for
    a value that it refuses. Times are the device's, mapped onto the host's clock; of receipt where it stamps
    none.
    """

    serial: str = ""

    def __post_init__(self) -> None:
        GrabbedCamera.__init__(self, "pylon", lambda: _PylonSource(self.serial, self), _OPENING_S)


def import_pylon() -> tuple[Any, Any]:
    """Modules `pylon` and `genicam` of pypylon; InputError (one line) where it is not installed."""
    try:
        pylon, genicam = (importlib.import_module(f"pypylon.{name}") for name in ("pylon", "genicam"))
    except ImportError as error:
        raise InputError("camera.driver: 'pylon': needs pypylon: pip install 'zeromethod[pylon]'") from error
    return pylon, genicam


def found() -> list[tuple[str, str]]:
    """Serial number and name of every Basler camera."""
    pylon, _ = import_pylon()
    devices = pylon.TlFactory.GetInstance().EnumerateDevices()
    return [(device.GetSerialNumber(), device.GetFriendlyName()) for device in devices]


def _create(pylon: Any, serial: str) -> Any:
    factory = pylon.TlFactory.GetInstance()
    devices = {device.GetSerialNumber(): device for device in factory.EnumerateDevices()}
    if not devices:
        raise InputError(f"camera.serial: {serial!r}: no Basler camera is connected")
    if serial and serial not in devices:
        raise InputError(f"camera.serial: {serial!r}: allowed: {', '.join(devices)}")
    return factory.CreateDevice(devices[serial] if serial else next(iter(devices.values())))


class _PylonFeatures:
    """A node map as `Features`."""

    def __init__(self, nodes: Any, genicam: Any) -> None:
        self._nodes = nodes
        self._genicam = genicam

    def available(self, name: str) -> bool:
        node = self._nodes.GetNode(name)
        return node is not None and bool(self._genicam.IsReadable(node))

    def get(self, name: str) -> Value:
        try:
            value: Value = self._nodes.GetNode(name).GetValue()
        except self._genicam.GenericException as error:
            raise FeatureError(_one_line(error)) from error
        return value

    def put(self, name: str, value: Value) -> None:
        node = self._nodes.GetNode(name)
        try:
            node.SetValue(round(float(value)) if hasattr(node, "GetInc") and _is_integer(node) else value)
        except (self._genicam.GenericException, TypeError, ValueError) as error:
            raise FeatureError(_one_line(error)) from error

    def execute(self, name: str) -> None:
        try:
            self._nodes.GetNode(name).Execute()
        except self._genicam.GenericException as error:
            raise FeatureError(_one_line(error)) from error

    def bounds(self, name: str) -> tuple[float, float] | None:
        node = self._nodes.GetNode(name)
        return (node.GetMin(), node.GetMax()) if hasattr(node, "GetMin") else None

    def choices(self, name: str) -> Sequence[str]:
        node = self._nodes.GetNode(name)
        if node is None or not hasattr(node, "GetSymbolics") or not self.available(name):
            return ()
        entries = [(symbol, node.GetEntryByName(symbol)) for symbol in node.GetSymbolics()]
        return [symbol for symbol, entry in entries if entry and self._genicam.IsAvailable(entry)]


def _is_integer(node: Any) -> bool:
    return isinstance(node.GetMin(), int)


def _one_line(error: Exception) -> str:
    """The device's message, without the place in its library."""
    return " ".join(str(error).split(" : ")[0].split())


class _PylonSource(GenICamSource):
    """An opened camera that grabs."""

    def __init__(self, serial: str, settings: Settings) -> None:
        self._pylon, self._genicam = import_pylon()
        self._clock = HostClock()
        self._lost = 0
        self._camera = self._pylon.InstantCamera(_create(self._pylon, serial))
        try:
            self._open(serial)
            self._set_up(_PylonFeatures(self._camera.GetNodeMap(), self._genicam), settings)
            self._camera.StartGrabbing(self._pylon.GrabStrategy_LatestImageOnly)
        except BaseException:
            self.close()
            raise

    def _open(self, serial: str) -> None:
        try:
            self._camera.Open()
        except self._genicam.GenericException as error:
            raise InputError(
                f"camera.serial: {serial!r}: cannot be opened: {in_words(_one_line(error))}"
            ) from error

    @gives_buffers
    def grab(self) -> Frame | None:
        """Next frame, or None when none came in a moment; raises CameraLost when the device was removed."""
        if self._trigger_due():
            self._fire()
        result = self._camera.RetrieveResult(round(1e3 * POLL_S), self._pylon.TimeoutHandling_Return)
        received_ns = self._clock.now_ns()
        # good frames may keep coming from a removed device: they are old
        if self._camera.IsCameraDeviceRemoved():
            raise CameraLost("the camera was removed")
        if not result.IsValid():
            return None
        try:
            self._lost += result.GetNumberOfSkippedImages()
            if not result.GrabSucceeded():
                self._lost += 1
                self._trigger_answered()
                return None
            image, ticks = result.Array, result.TimeStamp
        finally:
            result.Release()
        self._check_shape(image.shape)
        dropped, self._lost = self._lost, 0
        return self._frame(image, received_ns, ticks, dropped)

    def _fire(self) -> None:
        if self._camera.WaitForFrameTriggerReady(round(1e3 * POLL_S), self._pylon.TimeoutHandling_Return):
            self._camera.ExecuteSoftwareTrigger()

    def close(self) -> None:
        """Stop and close the device."""
        if self._camera.IsPylonDeviceAttached():
            self._camera.StopGrabbing()
            self._camera.Close()
            self._camera.DestroyDevice()
