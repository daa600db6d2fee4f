"""Options that name the real devices, shared by the commands: from `--display`, `--camera` to the rig."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click
from pydantic import ValidationError

from zeromethod.devices.addresses import with_camera
from zeromethod.errors import InputError
from zeromethod.rig.model import CameraSpec, DisplaySpec, Rig
from zeromethod.rig.refusal import first_refusal

_SIMULATED = "simulated"
_REAL_CAMERAS = frozenset({"opencv", "pylon", "aravis"})
_RATE_TOLERANCE = 0.02
_LATENCY_S = (-1.0, 10.0)

_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.option(
        "--display", "monitor", type=click.IntRange(min=0), help="The LCD is this monitor: see `devices`."
    ),
    click.option(
        "--camera", "address", metavar="ADDRESS",
        help="0, a URL, a video file, pylon[:serial], aravis[:address] or package.module:Name.",
    ),
    click.option("--exposure", "exposure_s", type=float, metavar="S", help="Exposure of the camera, s."),
    click.option("--camera-gain", type=float, metavar="G", help="Gain of the camera, in its own units."),
    click.option("--pixel-format", metavar="F", help="Pixel format of the camera: Mono8, Mono12, ..."),
)  # fmt: skip


@dataclass(frozen=True)
class BenchOptions:
    """What was given of the shared options; None = not given."""

    monitor: int | None
    address: str | None
    exposure_s: float | None
    camera_gain: float | None
    pixel_format: str | None

    @property
    def named(self) -> bool:
        """Whether a real device is named."""
        return self.monitor is not None or self.address is not None


def bench_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the shared options to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def with_devices(rig: Rig, options: BenchOptions, camera_alone: bool = False) -> Rig:
    """Rig with the devices and settings of the command line in place of its own.

    Raises InputError, one line: monitors that are not there or not set to the rig's display (with the list),
    camera addresses and settings that are not allowed, a simulated device beside a real one. camera_alone:
    a camera without the LCD will do.
    """
    rig = _with_camera(rig, options)
    if options.monitor is not None:
        rig = _with_monitor(rig, options.monitor)
    camera, display = rig.camera.driver, rig.display.driver
    if options.monitor is not None and camera == _SIMULATED:
        raise InputError(
            f"--display: {options.monitor}: the simulated camera does not see monitors; allowed: with "
            "--camera, or a rig file with a camera of its own"
        )
    if options.address is not None and camera in _REAL_CAMERAS and display == _SIMULATED and not camera_alone:
        raise InputError(
            f"--camera: {options.address!r}: a camera does not see the simulated display; allowed: with "
            "--display, or a rig file with a display of its own"
        )
    return rig


def with_latency(rig: Rig, latency_s: float | None) -> Rig:
    """Rig with the delay of `--latency`; InputError where it is no such number."""
    if latency_s is None:
        return rig
    if not _LATENCY_S[0] <= latency_s <= _LATENCY_S[1]:
        raise InputError(f"--latency: {latency_s}: from {_LATENCY_S[0]:g} to {_LATENCY_S[1]:g} s")
    return rig.model_copy(update={"display": rig.display.model_copy(update={"latency_s": latency_s})})


def with_strips(rig: Rig, strips: bool | None, named: bool) -> Rig:
    """Rig with or without coded strips: as told, else as it says, else with them where devices are named."""
    if strips is None:
        if not named or "strips" in rig.control.model_fields_set:
            return rig
        strips = True
    control = rig.control.model_copy(update={"strips": "edges" if strips else "none"})
    return rig.model_copy(update={"control": control})


def _with_camera(rig: Rig, options: BenchOptions) -> Rig:
    exposure_s, gain = options.exposure_s, options.camera_gain
    if exposure_s is not None and not (math.isfinite(exposure_s) and exposure_s > 0):
        raise InputError(f"--exposure: {exposure_s}: a number of seconds above 0")
    if gain is not None and not (math.isfinite(gain) and gain >= 0):
        raise InputError(f"--camera-gain: {gain}: a number from 0 on")
    settings = {"exposure_s": exposure_s, "gain": gain, "pixel_format": options.pixel_format}
    given = {key: value for key, value in settings.items() if value is not None}
    if options.address is not None:
        return with_camera(rig, options.address, given)
    if not given:
        return rig
    if rig.camera.driver == _SIMULATED and given.keys() != {"exposure_s"}:
        name = "--camera-gain" if gain is not None else "--pixel-format"
        raise InputError(f"{name}: the simulated camera has none; allowed: with --camera")
    try:
        camera = CameraSpec.model_validate(rig.camera.model_dump(exclude_unset=True) | given)
    except ValidationError as error:
        raise InputError(f"camera.{first_refusal(error, CameraSpec)}") from None
    return rig.model_copy(update={"camera": camera})


def _with_monitor(rig: Rig, index: int) -> Rig:
    from zeromethod.drivers.monitors import monitors  # noqa: PLC0415 - needs a screen's libraries

    display = rig.display
    known = monitors()
    listed = ", ".join(map(str, known)) or "none is connected"
    if index not in range(len(known)):
        raise InputError(f"--display: {index}: no such monitor; allowed: {listed}")
    found = known[index]
    wanted = f"{display.columns} x {display.rows} px at {display.refresh_hz:g} Hz"
    slow = found.refresh_hz and abs(found.refresh_hz / display.refresh_hz - 1) > _RATE_TOLERANCE
    if (found.columns, found.rows) != (display.columns, display.rows) or slow:
        raise InputError(
            f"--display: {index}: set to another mode than the rig's display ({wanted}): set the monitor or "
            f"the rig file; monitors: {listed}"
        )
    own = (display.model_extra or {}) if display.driver == "window" else {}
    known_keys = {
        name: getattr(display, name) for name in display.model_fields_set & set(DisplaySpec.model_fields)
    }
    values = known_keys | own | {"driver": "window", "monitor": index}
    return rig.model_copy(update={"display": DisplaySpec.model_validate(values)})
