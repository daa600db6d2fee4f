"""`zeromethod calibrate`: take a bench through all steps, store what was found, show it, compare it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from zeromethod.calibration.camera_file import ASSUMED_PERCENT, CameraFile, load_camera
from zeromethod.calibration.fingerprint import check
from zeromethod.calibration.folder import ARRAYS, GIVEN, Stored, arrays_fault, home_of, load, newest
from zeromethod.calibration.level import Level
from zeromethod.cli.calibrate_known import ball_of, check_depths, check_known, edge_of, known_of, numbers_of
from zeromethod.cli.device_options import BenchOptions, given_rig, opened_devices, other_devices, with_devices
from zeromethod.cli.guide_page import PagePrompts, guide_page, watched
from zeromethod.cli.output import TerminalPrompts, check_folder, write_summary
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.commissioning.calibration import (
    Calibration,
    Plan,
    Recorded,
    evaluate_or_keep,
    recall,
    record,
    rest_alone,
    store_calibration,
)
from zeromethod.commissioning.calibration.plan import Known
from zeromethod.errors import InputError, MeasurementError
from zeromethod.operating.guide_tables import CALIBRATE
from zeromethod.optics import check_geometry
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.thread_limits import limit_threads
from zeromethod.view.calibration_table import (
    carrier_line,
    depth_line,
    difference_table,
    figure_table,
    parameter_table,
    verdict_line,
)

FIGURE = "calibration.png"
_PLAN = ("press_sigma_mm", "light", "delay", "rest_frames", "press_frames", "patience_s")
"""Options that are fields of `Plan`."""


def calibrate_bench(
    rig_name: str | None,
    depths: str,
    known: tuple[str, ...],
    edges: tuple[str, ...],
    find: bool | None,
    ball_text: str | None,
    camera_file: Path | None,
    camera_percent: float | None,
    output: Path | None,
    summary: Path | None,
    show_folder: str | None,
    compared: tuple[Path, Path] | None,
    again_folder: Path | None,
    view: str | None = None,
    **others: Any,
) -> Stored | None:
    """Do what the command line asks for; the calibration that was made or shown.

    others: fields of `Plan` and `BenchOptions`.

    Raises InputError and MeasurementError; the latter, too, once one whose verdict is bad is stored.
    """
    console = Console()
    if compared:
        before, after = load(compared[0]), load(compared[1])
        console.print(difference_table(before, after))
        _warn_of_arrays(before)
        _warn_of_arrays(after)
        return None
    if show_folder is not None:
        shown = _wanted(show_folder, rig_name)
        _print(console, shown, summary)
        _warn_of_arrays(shown)
        return shown
    lens = _lens(camera_file, camera_percent)
    direct: tuple[Known, ...] = (*map(known_of, known), *map(edge_of, edges))
    direct += (lens.intrinsics,) if lens is not None else ()
    ball_mm = ball_of(ball_text) if ball_text is not None else None
    limit_threads()
    own = {name: others.pop(name) for name in _PLAN}
    own = {name: value for name, value in own.items() if value is not None}
    depths_mm = numbers_of("--press-depths", depths, "depths in mm")
    if again_folder is not None:
        pressed = _Pressed(depths_mm, own.get("press_sigma_mm"), ball_mm)
        stored = _evaluate_again(again_folder, direct, lens, pressed, find, output)
        missing = other_devices(stored.fingerprint, load_rig(stored.rig_file))
        _print_stored(console, stored, summary, "".join(f" {option}" for option, _ in missing))
        return _refuse_bad(stored)
    if rig_name is None:
        raise InputError("--rig: missing: your rig file (zeromethod init my.toml makes one)")
    plan = Plan(press_depths_mm=depths_mm, known=direct, ball_mm=ball_mm, edges=find is not False, **own)
    options, home = BenchOptions(**others), output or home_of(rig_name)
    rig = _bench(rig_name, options, plan, lens)
    with _home(home), guide_page(view, CALIBRATE, rig.camera.bits) as feed:
        prompts = PagePrompts(feed)
        with stopped_by_signals():
            with opened_devices(rig) as opened:
                recorded, found = record(rig, watched(opened, feed), plan, prompts)
            calibrated = evaluate_with(recorded, found, rig_name, prompts)
        late: list[bool] = []
        with stopped_by_signals(lambda: late.append(True)):
            stored = _store(calibrated, rig_name, home, options.settings)
        if feed is not None:
            verdict = f"{verdict_line(stored)} {depth_line(stored)}"
            feed.set(state="done", step_name="Done", progress=None, verdict=verdict, fresh=False)
    _print_stored(console, stored, summary, _devices_words(options))
    if calibrated.recorded.interrupted:
        hint = f"evaluate it again: zeromethod calibrate --evaluate-again {shlex.quote(str(stored.folder))}"
        console.print(hint, soft_wrap=True, highlight=False)
    if late or calibrated.recorded.interrupted:
        raise KeyboardInterrupt
    _refuse_bad(stored)
    if recorded.failure:
        raise MeasurementError(f"{recorded.failure} (stored without it in {stored.folder})")
    return stored


def _lens(path: Path | None, sigma_percent: float | None) -> CameraFile | None:
    """The camera by itself; says so where its sigmas are assumed."""
    if path is None:
        if sigma_percent is not None:
            raise InputError("--intrinsics-sigma: only with --intrinsics")
        return None
    lens = load_camera(path, sigma_percent)
    if lens.states_no_sigma and sigma_percent is None:
        words = f"! {path}: states no sigmas: {ASSUMED_PERCENT:g} % of the focal length is assumed"
        click.echo(f"{words} (--intrinsics-sigma)", err=True)
    return lens


@contextmanager
def _home(home: Path) -> Iterator[None]:
    """Make the folder that calibrations go into; what nothing was stored in is taken away again."""
    made = [folder for folder in (home, *home.parents) if not folder.exists()]
    check_folder("--output", home)
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted: nothing was stored") from None
    finally:
        for folder in made:
            try:
                folder.rmdir()
            except OSError:  # not empty: something was stored
                break


def evaluate_with(
    recorded: Recorded, found: Any, rig_name: str, prompts: TerminalPrompts | None = None
) -> Calibration:
    """Evaluate, against the rig's last calibration where that is of the same bench."""
    before, last = newest(rig_name), None
    if before is not None and not check(before.fingerprint, recorded.rig):
        last = before.parameters
        if load_rig(before.folder / GIVEN).camera.focal_px != recorded.rig.camera.focal_px:
            del last["camera.scale"]  # it is relative to the rig file's
    try:
        return evaluate_or_keep(recorded, found, last, prompts or TerminalPrompts())
    except KeyboardInterrupt:
        click.echo("! interrupted: storing what was recorded (again: nothing is stored)", err=True)
        return rest_alone(replace(recorded, interrupted=True), found, "interrupted before the fit was done")


def _bench(rig_name: str, options: BenchOptions, plan: Plan, lens: CameraFile | None) -> Rig:
    """The rig as it is to be opened."""
    rig = with_devices(given_rig(rig_name), options)
    if not plan.presses:
        rig = rig.model_copy(update={"scenario": "none"})
    check_geometry(rig)
    check_known(rig, plan.known, lens)
    check_depths(rig, plan.press_depths_mm)
    return rig


def _store(
    found: Calibration,
    rig_name: str,
    home: Path | None,
    settings: dict[str, Any],
    again: Stored | None = None,
) -> Stored:
    from zeromethod.view.calibration_figure import draw_calibration  # noqa: PLC0415 - matplotlib loads slowly

    return store_calibration(
        found,
        rig_name,
        home=home,
        settings={f"camera.{key}": value for key, value in settings.items()},
        pictures={FIGURE: lambda path: draw_calibration(found, path)},
        again=again,
    )


@dataclass(frozen=True)
class _Pressed:
    """What is said again of presses that were recorded; empty and None for what holds as it was said."""

    depths_mm: tuple[float, ...]
    sigma_mm: float | None
    ball_mm: tuple[float, float] | None

    def in_plan(self, recorded: Recorded, folder: Path) -> Plan:
        """The plan with it. Raises InputError where other presses were recorded."""
        plan, presses = recorded.plan, recorded.presses
        if self.ball_mm is not None and (presses is None or presses.ball is None):
            raise InputError(f"--press-ball: {folder}: no ball was pressed for this calibration")
        made = len(presses.pressed) if presses is not None else 0
        if self.depths_mm and len(self.depths_mm) != made:
            given = ",".join(f"{depth:g}" for depth in self.depths_mm)
            raise InputError(
                f"--press-depths: {given}: {folder} has {made} presses: as many depths, in order"
            )
        check_depths(recorded.rig, self.depths_mm)
        return replace(
            plan,
            press_depths_mm=self.depths_mm or plan.press_depths_mm,
            press_sigma_mm=plan.press_sigma_mm if self.sigma_mm is None else self.sigma_mm,
            ball_mm=self.ball_mm or plan.ball_mm,
        )


def _evaluate_again(
    folder: Path,
    known: tuple[Known, ...],
    lens: CameraFile | None,
    pressed: _Pressed,
    find: bool | None,
    output: Path | None,
) -> Stored:
    recorded, stored = recall(folder)
    check_known(recorded.rig, known, lens)
    plan = pressed.in_plan(recorded, folder)
    named = {one.name for one in known}
    plan = replace(
        plan,
        known=(*(one for one in plan.known if one.name not in named), *known),
        edges=plan.edges if find is None else find,
    )
    found = evaluate_or_keep(replace(recorded, plan=plan), prompts=TerminalPrompts())
    return _store(found, str(folder / GIVEN), output or folder.absolute().parent, {}, stored)


def _wanted(folder: str, rig_name: str | None) -> Stored:
    if folder:
        return load(Path(folder))
    if rig_name is None:
        raise InputError("--show: which calibration? allowed: a folder, or with --rig its newest")
    found = newest(rig_name)
    if found is None:
        given_rig(rig_name, measured=False)  # says so where there is no such rig
        raise InputError(
            f"--show: {rig_name}: no calibration in {home_of(rig_name)}: zeromethod calibrate makes one"
        )
    return found


def _devices_words(options: BenchOptions) -> str:
    """The same devices for another command, each with a blank before it."""
    monitor = "" if options.monitor is None else f" --display {options.monitor}"
    return monitor + ("" if options.address is None else f" --camera {shlex.quote(options.address)}")


def _print_stored(console: Console, stored: Stored, summary: Path | None, devices: str) -> None:
    """Print the tables, write the summary, and say where they are. devices: options of `run`."""
    _print(console, stored, summary)
    console.print(f"stored in {stored.folder}", soft_wrap=True, highlight=False)
    if stored.level is not Level.BAD:
        command = f"zeromethod run --rig {shlex.quote(str(stored.rig_file))}{devices}"
        console.print(f"use it: {command}", soft_wrap=True, highlight=False)


def _warn_of_arrays(stored: Stored) -> None:
    if fault := arrays_fault(stored.folder):
        words = f"! {stored.folder / ARRAYS}: {fault}: run and --evaluate-again will refuse it"
        click.echo(words, err=True)


def _refuse_bad(stored: Stored) -> Stored:
    if stored.level is Level.BAD:
        reason = stored.document["verdict"]["reason"]
        raise MeasurementError(f"calibration: {reason} (stored in {stored.folder})")
    return stored


def _print(console: Console, stored: Stored, summary: Path | None) -> None:
    console.print(parameter_table(stored))
    console.print(figure_table(stored))
    console.print(depth_line(stored), soft_wrap=True)
    console.print(verdict_line(stored), soft_wrap=True)
    if stored.level is not Level.BAD and (carrier := carrier_line(stored)):
        console.print(f"{carrier} ([target] period_px; then calibrate again)", soft_wrap=True, markup=False)
    if warning := stored.age_warning():
        console.print(f"! {warning}", soft_wrap=True)
    if summary is not None:
        time = stored.document["time"].isoformat()
        write_summary(summary, stored.document | {"time": time, "folder": str(stored.folder)})
