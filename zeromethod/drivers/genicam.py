"""A GenICam camera set up by its features, for any library and any maker's names of them."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from zeromethod.arrays import Image
from zeromethod.devices.protocols import CameraLost, Frame
from zeromethod.drivers.device_clock import DeviceClock, MidExposure
from zeromethod.errors import InputError

Value = bool | int | float | str

FORMATS = {"Mono8": 8, "Mono10": 10, "Mono12": 12, "Mono14": 14, "Mono16": 16}
"""Pixel formats that are read, and their bits: grey, not packed, LSB-aligned."""

# The Standard Feature Naming Convention's names first, then those of cameras that are older than it.
_EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
_GAIN = ("Gain", "GainAbs", "GainRaw")
_RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_TICKS_HZ = ("GevTimestampTickFrequency", "TimestampTickFrequency")
_TRIGGERS = ("FrameStart", "ExposureStart", "FrameBurstStart", "AcquisitionStart")

REPEAT_S = 2.0
"""How long a triggered frame is waited for."""


class FeatureError(Exception):
    """The device refused a value, or lacks the feature; the message is the device's."""


class Features(Protocol):
    """The features of an opened device by name."""

    def available(self, name: str) -> bool:
        """Whether it has this feature now."""

    def get(self, name: str) -> Value:
        """Present value; raises FeatureError."""

    def put(self, name: str, value: Value) -> None:
        """Set a value; raises FeatureError."""

    def execute(self, name: str) -> None:
        """Carry out a command; raises FeatureError."""

    def bounds(self, name: str) -> tuple[float, float] | None:
        """Least and greatest value of a number, None where it has no such bounds."""

    def choices(self, name: str) -> Sequence[str]:
        """Entries of an enumeration that can be chosen now; empty when it is none."""


def identity(features: Features) -> tuple[str, str]:
    """(serial number, model) of the device, "" for what it does not say."""
    found = []
    for names in (("DeviceSerialNumber", "DeviceID"), ("DeviceModelName",)):
        value: Value = ""
        for name in names:
            if not value and features.available(name):
                with contextlib.suppress(FeatureError):
                    value = features.get(name)
        found.append(str(value))
    return found[0], found[1]


@dataclass(repr=False, eq=False)
class Settings:
    """Settings of a camera in the rig file; see `zeromethod.rig.model.CameraSpec` for the keys.

    features: any others, by the device's own names, set before these. trigger_source: input of a hardware
    trigger. latency_s: from the end of an exposure until the frame is received.
    """

    columns: int
    rows: int
    bits: int
    rate_hz: float
    exposure_s: float
    gain: float | None = None
    pixel_format: str | None = None
    region_px: Sequence[int] | None = None
    trigger: str = "free"
    trigger_source: str = "Line1"
    latency_s: float = 0.0
    features: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Configured:
    """Settings that the camera has taken. exposure_s: as the device has it; tick_ns: of its time stamps."""

    exposure_s: float
    bits: int
    tick_ns: float


class GenICamSource:
    """The part of an opened camera's `Source` that is the same for every library."""

    on_demand: bool

    def _set_up(self, features: Features, settings: Settings, tick_ns: float | None = None) -> None:
        """Configure the camera. tick_ns: of its time stamps; None: as the device says."""
        configured = configure(features, settings)
        self.shape = settings.rows, settings.columns
        self.bits = configured.bits
        self.on_demand = settings.trigger == "software"
        self.serial, self.model = identity(features)
        clock = DeviceClock(tick_ns or configured.tick_ns)
        self._times = MidExposure(configured.exposure_s, settings.latency_s, clock)
        self._settings_of = features
        self._triggered_s = -math.inf
        self._number = -1

    def set_exposure(self, exposure_s: float) -> float:
        """Expose later frames for so long, s; what the device took. Raises InputError."""
        taken_s = set_exposure(self._settings_of, exposure_s)
        self._times.set_exposure(taken_s)
        return taken_s

    def _trigger_due(self) -> bool:
        """Whether to trigger now: once per frame, and again where that does not come for `REPEAT_S`."""
        now_s = time.monotonic()
        due = self.on_demand and now_s - self._triggered_s > REPEAT_S
        if due:
            self._triggered_s = now_s
        return due

    def _trigger_answered(self) -> None:
        """The triggered frame has come, whole or not."""
        self._triggered_s = -math.inf

    def _check_shape(self, shape: tuple[int, ...]) -> None:
        if shape != self.shape:
            raise CameraLost(f"its frames are now {shape}")

    def _frame(self, image: Image, received_ns: int, ticks: int, dropped: int) -> Frame:
        """The next frame; ticks: its time stamp, 0 for none."""
        self._trigger_answered()
        self._number += 1 + dropped
        middle_ns = self._times.of(received_ns, ticks)
        return Frame(image, middle_ns, self._times.exposure_ns, self._number, dropped)


def configure(features: Features, settings: Settings) -> Configured:
    """Set a camera up; InputError (one line: key, value, what it allows) for what it refuses.

    A gain, an exposure or a trigger that the device does not have is refused; a frame rate that
    cannot be set is left to it.
    """
    for name, value in settings.features.items():
        _put(features, f"features.{name}", name, value)
    pixel_format = settings.pixel_format or f"Mono{settings.bits}"
    bits = _pixel_format(features, pixel_format, settings.bits)
    _region(features, settings)
    # a frame rate left over from before could forbid the exposure, and the other way round
    _optionally(features, "AcquisitionFrameRateEnable", False)
    for name, value in (("ExposureAuto", "Off"), ("GainAuto", "Off"), ("ExposureMode", "Timed")):
        _optionally(features, name, value)
    exposure_s = set_exposure(features, settings.exposure_s)
    if settings.gain is not None:
        _put(features, "gain", _first(features, "gain", settings.gain, _GAIN), settings.gain)
    _trigger(features, settings)
    rate = next((name for name in _RATE if features.available(name)), None)
    if rate and settings.trigger == "free":
        _optionally(features, "AcquisitionFrameRateEnable", True)
        _put(features, "rate_hz", rate, settings.rate_hz)
    _optionally(features, "AcquisitionMode", "Continuous")
    ticks = next((name for name in _TICKS_HZ if features.available(name)), None)
    ticks_hz = float(features.get(ticks)) if ticks else 1e9
    return Configured(exposure_s, bits, 1e9 / ticks_hz if ticks_hz > 0 else 1.0)


def set_exposure(features: Features, exposure_s: float) -> float:
    """Set the exposure, s; what the device made of it. Raises InputError."""
    name = _first(features, "exposure_s", exposure_s, _EXPOSURE)
    _put(features, "exposure_s", name, 1e6 * exposure_s, exposure_s, 1e-6)
    return 1e-6 * float(features.get(name))


def _pixel_format(features: Features, name: str, bits: int) -> int:
    offered = [choice for choice in features.choices("PixelFormat") if choice in FORMATS]
    if name not in FORMATS or (offered and name not in offered):
        raise InputError(f'camera.pixel_format: "{name}": the device allows {_listed(offered)}')
    if FORMATS[name] != bits:
        raise InputError(f'camera.pixel_format: "{name}": has {FORMATS[name]} bits; camera.bits is {bits}')
    _put(features, "pixel_format", "PixelFormat", name)
    return FORMATS[name]


def _region(features: Features, settings: Settings) -> None:
    """Cut the region out of the sensor; without one, its first columns and rows."""
    x, y, columns, rows = settings.region_px or (0, 0, settings.columns, settings.rows)
    for name in ("OffsetX", "OffsetY"):  # a width may be limited by the offset
        _optionally(features, name, 0)
    key = "region_px" if settings.region_px else ""
    _put(features, key or "columns", "Width", columns)
    _put(features, key or "rows", "Height", rows)
    for name, offset in (("OffsetX", x), ("OffsetY", y)):
        if offset:
            _put(features, "region_px", name, offset)


def _trigger(features: Features, settings: Settings) -> None:
    wanted = settings.trigger != "free"
    chosen = features.choices("TriggerSelector")
    if wanted and not features.available("TriggerMode"):
        raise InputError(f'camera.trigger: "{settings.trigger}": the device has none; allowed: "free"')
    for selector in [name for name in _TRIGGERS if name in chosen]:
        features.put("TriggerSelector", selector)
        _optionally(features, "TriggerMode", "Off")
    if not wanted:
        return
    if "FrameStart" in chosen:
        features.put("TriggerSelector", "FrameStart")
    source = "Software" if settings.trigger == "software" else settings.trigger_source
    key = "trigger" if settings.trigger == "software" else "trigger_source"
    _put(features, key, "TriggerSource", source)
    _put(features, "trigger", "TriggerMode", "On")


def _first(features: Features, key: str, value: Value, names: Sequence[str]) -> str:
    for name in names:
        if features.available(name):
            return name
    raise InputError(f"camera.{key}: {value!r}: the device has none of {', '.join(names)}")


def _optionally(features: Features, name: str, value: Value) -> None:
    if features.available(name):
        with contextlib.suppress(FeatureError):  # a feature that is fixed on this device
            features.put(name, value)


def _put(
    features: Features, key: str, name: str, value: Value, asked: Value | None = None, unit: float = 1.0
) -> None:
    """Set `name` to `value`; where that fails, refuse `asked` for the rig's `key`, in units of `unit`."""
    where = f"camera.{key}: {_shown(value if asked is None else asked)}"
    if not features.available(name):
        raise InputError(f"{where}: the device has no {name}")
    bounds = features.bounds(name)
    if bounds and isinstance(value, int | float) and not bounds[0] <= value <= bounds[1]:
        low, high = (unit * bound for bound in bounds)
        raise InputError(f"{where}: the device allows {name} from {low:.10g} to {high:.10g}")
    choices = features.choices(name)
    if choices and value not in choices:
        raise InputError(f"{where}: the device allows {_listed(choices)}")
    try:
        features.put(name, value)
    except FeatureError as error:
        raise InputError(f"{where}: the device refused it: {error}") from error


def _shown(value: Value) -> str:
    return f'"{value}"' if isinstance(value, str) else f"{value!r}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f'"{name}"' for name in names) or f"none of {', '.join(FORMATS)}"
