"""Options that change a rig, shared by the commands: its devices, the delay, the scenario."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from zeromethod.cli.numbers import Real, Whole
from zeromethod.cli.output import several
from zeromethod.devices.abilities import warnings_of
from zeromethod.devices.addresses import with_camera
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import SIMULATED, CameraSpec, DisplaySpec, Rig

REAL_CAMERAS = frozenset({"opencv", "pylon", "aravis"})
"""Drivers of cameras that cannot observe a simulated display."""

_RIG = "rig: "
"""How messages about the name of a rig begin."""

WINDOW = "display window: "
"""How messages about the screen begin; left out where only monitors are listed."""

_VALUE = r"""('[^']*'|"[^"]*"|.*?): """
_REFUSED = (
    ("--watch-camera", "watch_address", r"watch camera(\.(driver|source|address|serial): " + _VALUE + "|: )"),
    ("--watch-camera", "watch_address", r"watch\.driver: " + _VALUE),
    ("--camera", "address", r"(camera|arrays)(\.(driver|source|address|serial): " + _VALUE + "|: )"),
    ("--display", "monitor", "display window: "),
    ("--project", "project", r"display window: |projector\.monitor: " + _VALUE),
)
"""Options that name devices, their parameters, and how messages begin that refuse one by the rig's keys."""


def _said_by_option(message: str, typed: Mapping[str, Any]) -> str:
    """A message about a device by the option that named it, if one did. typed: values by parameter."""
    for option, parameter, begins in _REFUSED:
        value = typed.get(parameter)
        if value is not None and (found := re.match(begins, message)):
            return f"{option}: {value!r}: {message[found.end() :]}"
    return message


def _saying_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command, whose refusals of devices name what the user typed."""

    @functools.wraps(command)
    def saying(**given: Any) -> None:
        try:
            command(**given)
        except InputError as error:
            raise InputError(_said_by_option(str(error), given)) from error

    return saying


bench_options = several(
    click.option(
        "--display", "monitor", type=Whole(min=0), help="The LCD is this monitor: see `devices`."
    ),
    click.option(
        "--camera", "address", metavar="ADDRESS",
        help="0, a URL, a video file, pylon[:serial], aravis[:address] or package.module:Name.",
    ),
    click.option(
        "--exposure", "exposure_s", type=Real(min=0, min_open=True), metavar="S", help="Exposure time, s."
    ),
    click.option(
        "--camera-gain", "gain", type=Real(min=0), metavar="G", help="Gain of the camera, its own units."
    ),
    click.option("--pixel-format", metavar="F", help="Pixel format of the camera: Mono8, Mono12, ..."),
    click.option(
        "--region", "region_px", type=Whole(min=0), nargs=4, metavar="X Y W H",
        help="Part of the camera's sensor: first column, first row, columns, rows.",
    ),
    click.option(
        "--trigger", type=click.Choice(["free", "software", "hardware"]),
        help="What starts the camera's exposures.",
    ),
    _saying_options,
)  # fmt: skip

_NAMES = {
    "monitor": "--display",
    "address": "--camera",
    "exposure_s": "--exposure",
    "gain": "--camera-gain",
    "pixel_format": "--pixel-format",
    "region_px": "--region",
    "trigger": "--trigger",
}
BENCH_OPTIONS = frozenset(_NAMES.values())

scenario_options = several(
    click.option(
        "--scenario",
        help="What presses the simulated mirror: a packaged scenario (step, hold, ...) or a .toml file.",
    ),
    click.option("--seed", type=Whole(min=0), help="Seed of the simulated bench."),
)
control_options = several(
    click.option(
        "--gain", "loop_gain", type=Real(0, 1, min_open=True), help="Share of each correction applied."
    ),
    click.option(
        "--controller", type=click.Choice(["composition", "integrator"]), help="How corrections are applied."
    ),
)


def rig_option(default: str = "simulated") -> Callable[[Any], Any]:
    """The option `--rig`, a packaged rig without it."""
    words = "Rig file, or a packaged name."
    return click.option("--rig", "rig_name", default=default, show_default=True, help=words)


def given_rig(name: str, option: str = "--rig", *, measured: bool = True) -> Rig:
    """The rig that an option gives, as `load_rig`; what is no rig at all is refused by the option's name."""
    try:
        return load_rig(name, measured=measured)
    except InputError as error:
        if not str(error).startswith(_RIG):
            raise
        raise InputError(f"{option}: {str(error).removeprefix(_RIG)}") from None


@dataclass(frozen=True)
class BenchOptions:
    """What was given of the shared options; None = not given. From `exposure_s` on, keys of `[camera]`."""

    monitor: int | None = None
    address: str | None = None
    exposure_s: float | None = None
    gain: float | None = None
    pixel_format: str | None = None
    region_px: tuple[int, int, int, int] | None = None
    trigger: str | None = None

    @property
    def given(self) -> tuple[str, ...]:
        """The options that were given, as they are typed."""
        return tuple(_NAMES[field.name] for field in fields(self) if getattr(self, field.name) is not None)

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of `[camera]` that were given."""
        keys = (field.name for field in fields(self) if field.name not in {"monitor", "address"})
        return {key: getattr(self, key) for key in keys if getattr(self, key) is not None}


def given_options(context: click.Context) -> list[str]:
    """Options that were typed, in their long form, in the order of the help."""
    typed = ((option, context.get_parameter_source(option.name or "")) for option in context.command.params)
    return [max(option.opts, key=len) for option, source in typed if source is ParameterSource.COMMANDLINE]


def with_devices(
    rig: Rig, options: BenchOptions, camera_alone: bool = False, *, passive: bool = False
) -> Rig:
    """Rig with the devices and settings of the command line in place of its own.

    Raises InputError, one line: monitors that are not there or not set to the rig's display (with the list),
    camera addresses and settings that are not allowed, a simulated device with a real one, rigs
    whose pattern stays unless `passive`. camera_alone: the camera is used without the LCD.
    """
    if rig.control.passive and not (passive or camera_alone):
        raise InputError(
            f"rig {rig.name!r}: control.controller: 'passive': a pattern that stays cannot show the pictures "
            "that this needs; allowed: the rig of the same bench with an LCD"
        )
    rig = _with_camera(rig, options)
    if options.monitor is not None:
        rig = _with_monitor(rig, options.monitor)
    camera, display = rig.camera.driver, rig.display.driver
    if options.monitor is not None and camera == SIMULATED:
        raise InputError(
            f"--display: {options.monitor}: the simulated camera cannot observe a monitor; allowed: with "
            "--camera, or a rig file with a camera of its own"
        )
    if camera in REAL_CAMERAS and display == SIMULATED and not camera_alone:
        address = options.address
        where = f"camera.driver: {camera!r}" if address is None else f"--camera: {address!r}"
        raise InputError(
            f"{where}: a camera cannot observe the simulated display; allowed: with --display, or a rig file "
            "with a display of its own"
        )
    return rig


def other_devices(
    fingerprint: Mapping[str, Mapping[str, Any]], rig: Rig
) -> list[tuple[str, CameraSpec | DisplaySpec]]:
    """Devices of the rig with other drivers than it was calibrated with, and the options that name them."""
    pairs = (("--display N", "display", rig.display), ("--camera ADDRESS", "camera", rig.camera))
    return [
        (option, spec)
        for option, table, spec in pairs
        if fingerprint.get(table, {}).get("driver", spec.driver) != spec.driver
    ]


@contextmanager
def opened_devices(rig: Rig, err: bool = True) -> Iterator[Devices]:
    """Devices of a rig, open; warnings about the display are printed, among errors or not."""
    with open_devices(rig) as devices:
        for warning in warnings_of(devices.display):
            click.echo(f"! {warning}", err=err)
        yield devices


def without_display(rig: Rig) -> Rig:
    """Rig whose display shows nothing, for the camera alone."""
    values = rig.display.given() | {"driver": "zeromethod.drivers.blank:BlankDisplay"}
    return rig.model_copy(update={"display": DisplaySpec.model_validate(values)})


def say_simulated(rig: Rig) -> None:
    """Say so where the bench is simulated."""
    if rig.camera.driver == SIMULATED:
        click.echo(f"rig {rig.name!r} is simulated: real devices are named by --display and --camera")


def with_given(rig: Rig, scenario: str | None, **tables: Mapping[str, Any]) -> Rig:
    """Rig with the values of options in place of its own, None for those that were not given.

    scenario: of `--scenario`. tables: `display={"latency_s": 0.02}`, checked by their options.
    """
    update: dict[str, Any] = {} if scenario is None else {"scenario": checked_scenario(scenario)}
    for table, values in tables.items():
        given = {key: value for key, value in values.items() if value is not None}
        update[table] = getattr(rig, table).model_copy(update=given)
    changed = rig.model_copy(update=update)
    if changed.control.rubbing and (hidden := changed.rubs_unseen):
        raise InputError(f"--rubbing: not {hidden}")
    return changed


def check_simulated(real: bool, scenario: str | None, seed: int | None) -> None:
    """Refuse options of the simulated bench where devices are real."""
    for option, value in (("--scenario", scenario), ("--seed", seed)):
        if value is not None and real:
            rule = "of the simulated bench, and these devices are real: leave it out"
            raise InputError(f"{option}: {value}: {rule}")


def checked_scenario(name: str) -> str:
    """A scenario's name; what is none is refused here, by its option, not as the bench is opened."""
    packaged = sorted(path.stem for path in resource("calibration", "presses").glob("*.toml"))
    path = Path(name)
    if name not in packaged and not (os.path.isfile(path) and (path.suffix or path.name != name)):
        raise InputError(f"--scenario: {name}: a press file (.toml), or one of {', '.join(packaged)}")
    return name


def _with_camera(rig: Rig, options: BenchOptions) -> Rig:
    given = options.settings
    try:
        if options.address is not None:
            rig = with_camera(rig, options.address, given)
        elif given:
            rig = rig.replace({f"camera.{key}": value for key, value in given.items()})
    except InputError as error:
        key, _, rest = str(error).removeprefix("rig: ").removeprefix("camera.").partition(":")
        if key not in given:
            raise
        raise InputError(f"{_NAMES[key]}:{rest}") from None
    unused = [key for key in given if key != "exposure_s"]
    if rig.camera.driver == SIMULATED and unused:
        raise InputError(f"{_NAMES[unused[0]]}: the simulated camera has none; allowed: with --camera")
    return rig


def _with_monitor(rig: Rig, index: int) -> Rig:
    from zeromethod.drivers.monitors import monitors  # noqa: PLC0415 - needs a screen's libraries

    display = rig.display
    if rig.light.by_mirror:
        rule = "a lamp lights a print (light.source); allowed: without --display"
        raise InputError(f"--display: {index}: rig {rig.name!r}: {rule}")
    try:
        known = monitors()
    except InputError as error:
        raise InputError(f"--display: {index}: {str(error).removeprefix(WINDOW)}") from None
    listed = ", ".join(map(str, known)) or "none is connected"
    if index not in range(len(known)):
        raise InputError(f"--display: {index}: no such monitor; allowed: {listed}")
    found = known[index]
    wanted = f"{display.columns} x {display.rows} px at {display.refresh_hz:g} Hz"
    if (found.columns, found.rows) != (display.columns, display.rows) or not found.runs_at(
        display.refresh_hz
    ):
        raise InputError(
            f"--display: {index}: set to another mode than the rig's display ({wanted}): set the monitor or "
            f"the rig file; monitors: {listed}"
        )
    own = (display.model_extra or {}) if display.driver == "window" else {}
    values = display.given() | own | {"driver": "window", "monitor": index}
    return rig.model_copy(update={"display": DisplaySpec.model_validate(values)})
