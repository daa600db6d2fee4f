"""`zeromethod devices`: what is connected, and setting it up."""

from __future__ import annotations

import signal
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from zeromethod.cli.device_options import WINDOW, BenchOptions, bench_options
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import check_file, write_summary
from zeromethod.errors import InputError
from zeromethod.thread_limits import limit_threads

_ALL = "all"
_IDENTIFY_S = 10.0


@dataclass(frozen=True)
class _Task:
    """One of --identify, --delay, --focus, and the options that go with it."""

    name: str
    rig_name: str | None
    options: BenchOptions
    seconds: float | None
    write: bool


@click.command(
    "devices",
    epilog="Example: zeromethod devices --focus --rig my.toml --display 1 --camera 0",
)
@click.option(
    "--identify",
    is_flag=False,
    flag_value=_ALL,
    metavar="[N]",
    help="Show on monitor N, or on all, which one it is and how it lies.",
)
@click.option(
    "--delay", is_flag=True, help="Measure the delay between display and camera; nothing may touch."
)
@click.option("--focus", is_flag=True, help="Set up by eye: focus, exposure, view, with advice. q ends it.")
@click.option("--rig", "rig_name", help="Rig file, or a packaged name.  [default: simulated]")
@bench_options
@click.option("--seconds", type=Real(min=0, min_open=True), help="How long to measure, look or show.")
@click.option("--write", is_flag=True, help="Store the measured delay in the rig file.")
@click.option("--summary", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures (.json).")
def devices_command(
    identify: str | None,
    delay: bool,
    focus: bool,
    rig_name: str | None,
    seconds: float | None,
    write: bool,
    summary: Path | None,
    **options: Any,
) -> None:
    """List monitors and cameras as `run` takes them, and what would have to be installed for more.

    With --identify, --focus or --delay: tell monitors apart, set up by eye, measure the delay.
    """
    check_file("--summary", summary, suffix=".json")
    names = (("--identify", identify is not None), ("--delay", delay), ("--focus", focus))
    asked = [name for name, given in names if given]
    if len(asked) > 1:
        raise InputError(f"{' and '.join(asked)}: give one of them")
    task = _Task(asked[0] if asked else "", rig_name, BenchOptions(**options), seconds, write)
    _check_options(task)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    limit_threads()
    if identify is not None:
        figures = _identify(identify, task)
    elif delay:
        from zeromethod.cli.delay import report_delay  # noqa: PLC0415 - the bench's libraries load slowly

        figures = report_delay(rig_name or "simulated", task.options, seconds, write)
    elif focus:
        from zeromethod.cli.focus import watch_focus  # noqa: PLC0415

        watch_focus(rig_name or "simulated", task.options, seconds, summary)
        return
    else:
        figures = _list()
    if summary is not None:
        write_summary(summary, figures)


def _check_options(task: _Task) -> None:
    """Refuse options that would go unheeded."""
    if task.write and task.name != "--delay":
        raise InputError("--write: only with --delay")
    if task.name in {"--delay", "--focus"}:
        return
    if task.options.given:
        raise InputError(f"{task.options.given[0]}: only with --focus or --delay")
    if not task.name:
        for name, value in (("--rig", task.rig_name), ("--seconds", task.seconds)):
            if value is not None:
                raise InputError(f"{name}: only with --identify, --focus or --delay")


def _list() -> dict[str, Any]:
    """Print monitors and cameras; the same as figures."""
    from zeromethod.drivers.listing import cameras  # noqa: PLC0415
    from zeromethod.drivers.monitors import monitors  # noqa: PLC0415
    from zeromethod.view.devices_table import cameras_table, monitors_table  # noqa: PLC0415

    console = Console()
    problem = ""
    try:
        known = monitors()
    except InputError as error:
        known, problem = (), str(error).removeprefix(WINDOW)
    if known:
        console.print(monitors_table(known))
    else:
        _say(console, f"no monitors: {problem or 'none is connected'}")
    for warning in dict.fromkeys(line for monitor in known for line in monitor.warnings):
        _say(console, f"! {warning}")
    listing = cameras()
    console.print()
    if listing.cameras:
        console.print(cameras_table(listing))
    else:
        _say(console, "no cameras found; --camera also takes a URL, a video file or package.module:Name")
    for line in listing.problems:
        _say(console, f"! {line}")
    for missing in listing.missing:
        _say(console, f"for {missing.adds} ({missing.driver}): {missing.install}")
    return {
        "monitors": [asdict(monitor) for monitor in known],
        "monitors_problem": problem,
        "cameras": [asdict(camera) for camera in listing.cameras],
        "missing": [asdict(missing) for missing in listing.missing],
        "problems": listing.problems,
    }


def _say(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, highlight=False, markup=False)


def _identify(which: str, task: _Task) -> dict[str, Any]:
    """Show the identify pictures; which monitors showed them."""
    from zeromethod.drivers.identify import identify  # noqa: PLC0415
    from zeromethod.rig.load import load_rig  # noqa: PLC0415

    if which != _ALL and not which.isdecimal():
        raise InputError(f"--identify: {which!r}: allowed: the index of a monitor, or nothing for all")
    turn_deg, mirrored = 0.0, False
    if task.rig_name is not None:
        display = load_rig(task.rig_name).display
        turn_deg, mirrored = display.turn_deg, display.mirrored
    index = None if which == _ALL else int(which)
    console, seconds = Console(), task.seconds or _IDENTIFY_S
    _say(console, f"each monitor tells its index for {seconds:g} s, or until a key is pressed there")
    shown = identify(seconds, index, turn_deg, mirrored)
    for one in shown:
        _say(console, f"monitor {one.monitor}")
        for warning in one.warnings:
            _say(console, f"! {warning}")
    return {"identified": [asdict(replace(one.monitor, warnings=one.warnings)) for one in shown]}
