"""`zeromethod devices`: what is connected, setting it up, and whether this computer is fast enough."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from zeromethod.cli.device_options import (
    BENCH_OPTIONS,
    WINDOW,
    BenchOptions,
    bench_options,
    given_options,
    given_rig,
    rig_option,
)
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import summary_option, wide_console, write_summary
from zeromethod.cli.page_options import view_option
from zeromethod.cli.stopping import quiet_imports
from zeromethod.errors import InputError
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.table import cell, text_table

if TYPE_CHECKING:
    from zeromethod.drivers.monitors import Monitor

_ALL = "all"
_IDENTIFY_S = 10.0
_TASKS = {
    "--identify": frozenset({"--rig", "--seconds"}),
    "--delay": frozenset({"--rig", "--seconds", "--write"}) | BENCH_OPTIONS,
    "--focus": frozenset({"--rig", "--seconds", "--view"}) | BENCH_OPTIONS,
    "--speed": frozenset({"--rig"}),
}
"""Every task, and the options that go with it, in addition to --summary."""


@click.command("devices", epilog="Example: zeromethod devices --focus --rig my.toml --display 1 --camera 0")
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
@click.option(
    "--speed", is_flag=True, help="Measure whether this computer is fast enough for the rig's camera."
)
@rig_option()
@bench_options
@click.option("--seconds", type=Real(min=0, min_open=True), help="How long to measure, look or show.")
@click.option("--write", is_flag=True, help="Store the measured delay in the rig file.")
@view_option
@summary_option
def devices_command(
    identify: str | None,
    delay: bool,
    focus: bool,
    speed: bool,
    rig_name: str,
    seconds: float | None,
    write: bool,
    view: str | None,
    summary: Path | None,
    **others: Any,
) -> None:
    """List monitors and cameras as `run` takes them, and what would have to be installed for more.

    With --identify, --focus or --delay: name the monitors, set up by eye, measure the delay. With --speed:
    time the loop, drawing, reading and recording on the rig's simulated bench; no device is needed, and the
    exit code is 1 if this computer is too slow.
    """
    _check_options(given_options(click.get_current_context()))
    limit_threads()
    options = BenchOptions(**others)
    if focus:
        with quiet_imports():
            from zeromethod.cli.focus import watch_focus  # noqa: PLC0415 - the bench's libraries load slowly

        watch_focus(rig_name, options, seconds, summary, view)
        return
    if identify is not None:
        figures = _identify(identify, rig_name, seconds or _IDENTIFY_S)
    elif delay:
        with quiet_imports():
            from zeromethod.cli.delay import report_delay  # noqa: PLC0415 - as above

        figures = report_delay(rig_name, options, seconds, write)
    else:
        figures = _speed(rig_name) if speed else _list()
    write_summary(summary, figures)
    if speed and not figures["fast_enough"]:
        click.get_current_context().exit(1)


def _check_options(given: list[str]) -> None:
    """Refuse two tasks, and options that the task does not use."""
    tasks = [option for option in given if option in _TASKS]
    if len(tasks) > 1:
        raise InputError(f"{' and '.join(tasks)}: give one of them")
    for option in (one for one in given if one not in {"--summary", *tasks}):
        allowed = [name for name, options in _TASKS.items() if option in options]
        if not set(tasks) & set(allowed):
            *first, last = allowed
            raise InputError(f"{option}: only with {', '.join(first)}{' or ' if first else ''}{last}")


def _list() -> dict[str, Any]:
    """Print monitors and cameras; the same as figures."""
    from zeromethod.drivers.listing import cameras  # noqa: PLC0415

    console = Console()
    known, problem = _monitors()
    rows = (
        (
            str(one.index),
            one.name,
            f"{one.columns} x {one.rows}",
            f"{one.refresh_hz:.2f} Hz" if one.refresh_hz else "not known",
            f"{one.x}, {one.y}",
            "primary" if one.primary else "",
        )
        for one in known
    )
    if known:
        console.print(text_table(("--display", "monitor", "size", "refresh", "at", ""), rows, left=range(6)))
    else:
        _say(console, f"no monitors: {problem or 'none is connected'}")
    for warning in dict.fromkeys(line for monitor in known for line in monitor.warnings):
        _say(console, f"! {warning}")
    listing = cameras()
    console.print()
    if listing.cameras:
        found = ((camera.address, camera.name) for camera in listing.cameras)
        console.print(text_table(("--camera", "name"), found, left=(0, 1)))
    else:
        _say(console, "no cameras found; --camera also takes a URL, a video file or package.module:Name")
    for line in listing.problems:
        _say(console, f"! {line}")
    for missing in listing.missing:
        _say(console, f"for {missing.adds} ({missing.driver}): {missing.install}")
    return {
        "monitors": [asdict(monitor) for monitor in known],
        "monitors_problem": problem,
        **asdict(listing),
    }


def _monitors() -> tuple[tuple[Monitor, ...], str]:
    """The monitors, and what is in the way of listing them."""
    from zeromethod.drivers.monitors import monitors  # noqa: PLC0415

    try:
        return monitors(), ""
    except InputError as error:
        return (), str(error).removeprefix(WINDOW)


def _say(console: Console, text: str) -> None:
    console.print(text, soft_wrap=True, highlight=False, markup=False)


def _identify(which: str, rig_name: str, seconds: float) -> dict[str, Any]:
    """Show the identify pictures; which monitors showed them."""
    from zeromethod.drivers.identify import identify  # noqa: PLC0415

    if which != _ALL and not which.isdecimal():
        raise InputError(f"--identify: {which!r}: allowed: the index of a monitor, or nothing for all")
    display = given_rig(rig_name).display
    console = Console()
    _say(console, f"each monitor shows its index for {seconds:g} s, or until a key is pressed there")
    number = None if which == _ALL else int(which)
    shown = identify(seconds, number, display.turn_deg, display.mirrored)
    for one in shown:
        _say(console, f"monitor {one.monitor}")
        for warning in one.warnings:
            _say(console, f"! {warning}")
    return {"identified": [asdict(replace(one.monitor, warnings=one.warnings)) for one in shown]}


_PARTS = {
    "loop": ("frame in to warp out", "frames are dropped"),
    "drawing": ("drawing the pattern", "the picture follows late"),
    "reading": ("reading the surface", "some frames are not read to depth"),
    "recording": ("recording everything", "some frames are not recorded"),
}
"""What each part is, and what follows where it is too slow."""


def _speed(rig_name: str) -> dict[str, Any]:
    """Measure and print what this computer can do on a rig; the figures."""
    with quiet_imports():
        from zeromethod.commissioning.delay import with_strips  # noqa: PLC0415
        from zeromethod.optics import check_geometry  # noqa: PLC0415
        from zeromethod.session.speed import STEPS, measure_speed  # noqa: PLC0415 - the loop loads slowly

    # as `run` closes the loop on real devices: with coded strips
    rig = given_rig(rig_name, measured=False)
    rig = with_strips(rig) if rig.control.strips == "auto" else rig
    check_geometry(rig)
    with progress(STEPS, "loop") as advance:
        figures = measure_speed(rig, Path.cwd(), advance)
    parts, rate_hz = figures["parts"], figures["camera_rate_hz"]
    rows = [
        (
            _PARTS[name][0],
            cell(part.get("ms", {}).get("median"), "{:.1f}"),
            cell(part.get("ms", {}).get("p90"), "{:.1f}"),
            cell(part["frames_per_s"], "{:.0f}"),
            cell(part.get("megabytes_per_s"), "{:.0f}"),
            "fast enough" if part["fast_enough"] else f"too slow: {_PARTS[name][1]}",
        )
        for name, part in parts.items()
    ]
    console = wide_console()
    columns, lines = figures["frame_px"]
    console.print(
        f"rig {figures['rig']}: {columns}x{lines} px, {rate_hz:g} frames/s, {1e3 / rate_hz:.1f} ms each; "
        f"{figures['cores']} cores, drawn by {figures['gl_renderer']}\n"
    )
    console.print(text_table(("", "ms median", "ms 90 %", "frames/s", "MB/s", ""), rows, left=(0, 5)))
    if figures.get("dis_fast_ms"):
        loop, reading = (parts[name]["of_dis_fast"] for name in ("loop", "reading"))
        console.print(
            f"\nOpenCV's flow between two frames (DIS, preset fast) takes {figures['dis_fast_ms']:.1f} ms: "
            f"frame in to warp out is {loop:.2f} of that, reading {reading:.2f}",
            soft_wrap=True,
        )
    slowest = figures["bottleneck"]
    verdict = "fast enough" if figures["fast_enough"] else "NOT fast enough"
    console.print(
        f"\nthis computer is {verdict} for {rate_hz:g} frames/s: the slowest part, {_PARTS[slowest][0]}, "
        f"manages {parts[slowest]['frames_per_s']:.0f}",
        soft_wrap=True,
    )
    return figures
