"""Opening of the devices that a rig's `[camera]` and `[display]` tables name.

A driver is any callable: the entry points of the groups `zeromethod.cameras` and `zeromethod.displays`
by name, or `package.module:Name` (the working directory is searched too, so a lab's own file will do).
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import TracebackType
from typing import Any, Literal, cast

from zeromethod.clock import Clock, HostClock, SimulatedClock
from zeromethod.devices.abilities import poll_of
from zeromethod.devices.contract import RAISED, said_by
from zeromethod.devices.protocols import Camera, Display
from zeromethod.errors import InputError, MeasurementError
from zeromethod.rig.model import CameraSpec, DisplaySpec, Rig, check_rig
from zeromethod.worker import call_within

Kind = Literal["camera", "display"]
Factory = Callable[..., Any]

_PROTOCOLS: dict[Kind, type] = {"camera": Camera, "display": Display}

CLOSING_S = 0.4
"""How long devices may take to close in the host's time when an error or Ctrl-C ends a run."""

ORDERLY_CLOSING_S = 5.0
"""The same when nothing hurries; a device that hangs is left to itself."""

LEAST_CLOSING_S = 0.1
"""What is left of that for the display, however long the camera took."""

OPENING_S = 30.0
"""How long a camera may take to open in the host's time."""

_SETTINGS = ("gain", "pixel_format", "region_px", "trigger")
"""Keys that a device must be set to: one that the driver does not name would have no effect."""


@cache
def _installed(kind: Kind) -> Mapping[str, EntryPoint]:
    """Entry points by name; looked up once, because it reads every installed package."""
    return {entry.name: entry for entry in entry_points(group=f"zeromethod.{kind}s")}


def load_driver(kind: Kind, name: str) -> Factory:
    """Find the factory of a driver, to be called as `factory(**options)`.

    name: an entry point, or `package.module:Name`. Raises InputError when there is no such driver or it
    cannot be imported.
    """
    where = f"{kind}.driver: {name!r}"
    module, colon, attribute = name.partition(":")
    known = {} if colon else _installed(kind)
    if not colon and name not in known:
        listed = ", ".join(sorted(known)) or "none is installed"
        raise InputError(f"{where}: unknown; allowed: {listed}, or package.module:Name")
    if colon and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        factory = getattr(importlib.import_module(module), attribute) if colon else known[name].load()
    except RAISED as error:  # whatever somebody else's code raises is reported in one line
        raise InputError(f"{where}: cannot be imported: {_one_line(error)}") from error
    if not callable(factory):
        raise InputError(f"{where}: not callable; allowed: a class or function that returns a {kind}")
    return cast(Factory, factory)


class WrongShape(InputError):
    """A camera's frames have not the shape that the rig says."""


@dataclass(repr=False)
class Devices:
    """Opened devices and the clock they share. A context manager that closes them, the camera first.

    Attributes
    ----------
    camera : Camera
        The opened camera; another one after it was opened again.
    display : Display
        The opened display.
    clock : Clock
        Simulated, or the host's.
    """

    camera: Camera
    display: Display
    clock: Clock
    _open_camera: Callable[[], Camera]
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)
    _openings: int = 0

    def __repr__(self) -> str:
        names = (type(part).__name__ for part in (self.camera, self.display, self.clock))
        return f"<Devices: {', '.join(names)}>"

    def reopen_camera(self) -> Camera:
        """Close the camera and open it again.

        One that opens only when it was asked for again, or after `close`, is its caller's alone.

        Returns
        -------
        Camera
            The camera, opened again.

        Raises
        ------
        InputError
            When that fails.
        """
        with self._lock:
            self._openings += 1
            opening = self._openings
        # a camera that is gone may well fail to close, too
        with contextlib.suppress(*RAISED):
            self._close("camera", self.camera, CLOSING_S)
        camera = self._open_camera()
        with self._lock:
            if opening == self._openings:
                self.camera = camera
        return camera

    def close(self, timeout_s: float = ORDERLY_CLOSING_S) -> None:
        """Close both devices; safe to call twice.

        In the host's time devices that take longer than `timeout_s` cannot. A display that has `poll` is
        closed in the caller's thread, as windows must be, however long that takes.

        Parameters
        ----------
        timeout_s : float
            Longest wait for devices in the host's time.

        Raises
        ------
        MeasurementError
            When a device cannot be closed.
        """
        with self._lock:
            self._openings += 1
        failed = []
        end_s = time.monotonic() + timeout_s
        for kind, device in (("camera", self.camera), ("display", self.display)):
            try:
                self._close(kind, device, max(end_s - time.monotonic(), LEAST_CLOSING_S))
            except RAISED as error:
                failed.append(f"{kind}: cannot be closed: {_one_line(error)}")
        if failed:
            raise MeasurementError("; ".join(failed))

    def _close(self, kind: str, device: Camera | Display, timeout_s: float) -> None:
        if isinstance(self.clock, HostClock) and (kind == "camera" or poll_of(device) is None):
            call_within(timeout_s, device.close, f"{kind} closing")
        else:
            device.close()

    def __enter__(self) -> Devices:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        # what went wrong first is what is reported
        with contextlib.suppress(MeasurementError):
            self.close(CLOSING_S)


def open_devices(rig: Rig, clock: Clock | None = None) -> Devices:
    """Open the rig's display, then its camera.

    A factory with `**options` gets every key that its table gives (but `driver`) and `clock`. Any other
    gets the table's own extra keys, those keys of the rig's schema that its signature names, and of
    `rig`, `clock` and `display` (cameras only: the opened display) those that it names.

    The clock is simulated when both factories name a parameter `clock`: such a device lives on the run's
    clock. If one does not, it lives in the host's time, and so does the run. `clock` overrides this.

    Parameters
    ----------
    rig : Rig
        The bench, whose `[camera]` and `[display]` name the drivers.
    clock : Clock, optional
        Clock of the run, in place of the one that the drivers ask for.

    Returns
    -------
    Devices
        The opened devices; a context manager that closes them.

    Raises
    ------
    InputError
        For unknown drivers or options, devices that cannot be opened, and devices that are not
        what the rig says.
    """
    check_rig("open_devices", rig)
    display_factory = load_driver("display", rig.display.driver)
    camera_factory = load_driver("camera", rig.camera.driver)
    if clock is None:
        simulated = "clock" in _names(display_factory) and "clock" in _names(camera_factory)
        clock = SimulatedClock() if simulated else HostClock()
    context = {"rig": rig, "clock": clock}
    display = cast(Display, _open("display", rig.display, display_factory, context))

    def reopen_camera() -> Camera:
        return open_camera(rig.camera, camera_factory, context | {"display": display})

    try:
        _check_display(display, rig.display)
        camera = (
            _within(OPENING_S, reopen_camera, rig.camera) if isinstance(clock, HostClock) else reopen_camera()
        )
    except BaseException:
        display.close()
        raise
    return Devices(camera, display, clock, reopen_camera)


def open_camera(spec: CameraSpec, factory: Factory, context: dict[str, Any]) -> Camera:
    """Open a camera by its table; context: what its driver may name besides. Raises InputError."""
    camera = cast(Camera, _open("camera", spec, factory, context))
    try:
        _check_camera(camera, spec)
    except BaseException:
        camera.close()
        raise
    return camera


def _within(timeout_s: float, open_camera: Callable[[], Camera], spec: CameraSpec) -> Camera:
    """Open in a thread of its own, as reopening does, so that one that hangs can be interrupted."""
    try:
        return call_within(timeout_s, open_camera, "camera opening")
    except TimeoutError as error:
        raise InputError(f"camera.driver: {spec.driver!r}: cannot be opened: {error}") from error


def _open(kind: Kind, table: CameraSpec | DisplaySpec, factory: Factory, context: dict[str, Any]) -> object:
    options = _options(kind, table, factory, context)
    where = f"{kind}.driver: {table.driver!r}"
    try:
        device: object = factory(**options)
    except InputError:
        raise
    except RAISED as error:
        raise InputError(f"{where}: cannot be opened: {_one_line(error)}") from error
    members = [name for name in _members(_PROTOCOLS[kind]) if not hasattr(device, name)]
    if members:
        raise InputError(f"{where}: not a {kind}: lacks {', '.join(members)}")
    return device


def _options(
    kind: Kind, table: CameraSpec | DisplaySpec, factory: Factory, context: dict[str, Any]
) -> dict[str, Any]:
    named, extra = _names(factory), dict(table.model_extra or {})
    ours = {name: value for name, value in context.items() if name in named}
    if _takes_any(factory):
        given = {name: value for name, value in table.given().items() if name != "driver"}
        return {"clock": context["clock"]} | given | extra | ours
    schema = {name: getattr(table, name) for name in type(table).model_fields if name != "driver"}
    for complaint in _complaints(table, factory, context, schema):
        raise InputError(f"{kind}.{complaint}")
    return ours | {name: value for name, value in schema.items() if name in named} | extra


def _complaints(
    table: CameraSpec | DisplaySpec, factory: Factory, context: dict[str, Any], schema: dict[str, Any]
) -> Iterator[str]:
    """What a factory without `**options` cannot be given, or lacks: "key: reason"."""
    named, extra = _names(factory), table.model_extra or {}
    allowed = [name for name in named if name not in context]
    for name, value in extra.items():
        if name not in allowed:
            listed = ", ".join(allowed) or "none"
            yield f"{name}: {value!r}: unknown option of {table.driver!r}; allowed: {listed}"
    for name in _SETTINGS if "rig" not in named else ():
        default = type(table).model_fields[name].default if name in schema else None
        if name not in named and schema.get(name) != default:
            yield f"{name}: {schema[name]!r}: driver {table.driver!r} cannot set it"
    for name in _required(factory):
        if name not in context | schema | extra:
            yield f"{name}: missing; driver {table.driver!r} needs it"


def _check_camera(camera: Camera, spec: CameraSpec) -> None:
    shape, wanted = tuple(camera.shape), (spec.rows, spec.columns)
    if shape != wanted:
        raise WrongShape(f"camera: the device's frames are {shape} (rows, columns); the rig says {wanted}")
    if camera.bits != spec.bits:
        raise InputError(f"camera.bits: the device gives {camera.bits}; the rig says {spec.bits}")


def _check_display(display: Display, spec: DisplaySpec) -> None:
    size, wanted = tuple(display.size), (spec.columns, spec.rows)
    if size != wanted:
        raise InputError(f"display: the device's size is {size} (columns, rows); the rig says {wanted}")


def _parameters(factory: Factory) -> list[inspect.Parameter]:
    return list(inspect.signature(factory).parameters.values())


def _names(factory: Factory) -> list[str]:
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [p.name for p in _parameters(factory) if p.kind in by_name]


def _required(factory: Factory) -> list[str]:
    named = _names(factory)
    return [p.name for p in _parameters(factory) if p.name in named and p.default is inspect.Parameter.empty]


def _takes_any(factory: Factory) -> bool:
    return any(p.kind is inspect.Parameter.VAR_KEYWORD for p in _parameters(factory))


def _members(protocol: type) -> list[str]:
    return [name for name in vars(protocol) if not name.startswith("_")]


def _one_line(error: BaseException) -> str:
    words, name = said_by(error), type(error).__name__
    return f"{name}: {words}" if words and isinstance(error, KeyError | SystemExit) else words or name
