"""`zeromethod check`: two minutes at the start of a day."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console

from zeromethod.calibration.folder import calibration_of
from zeromethod.cli.calibrate_known import check_depths
from zeromethod.cli.calibrated_bench import check_calibration
from zeromethod.cli.device_options import (
    REAL_CAMERAS,
    BenchOptions,
    bench_options,
    check_simulated,
    given_rig,
    opened_devices,
    rig_option,
    say_simulated,
    scenario_options,
    with_devices,
    with_given,
)
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import TerminalPrompts, folder_for, summary_option, write_summary, writing
from zeromethod.commissioning.daily_check.check import check_bench
from zeromethod.commissioning.daily_check.findings import DailyCheck, Fitness
from zeromethod.commissioning.daily_check.log import append_check, log_of
from zeromethod.errors import InputError, MeasurementError
from zeromethod.optics import check_geometry
from zeromethod.session.trust import is_known
from zeromethod.thread_limits import limit_threads
from zeromethod.view.table import text_table

NEVER = (
    "never calibrated: there is nothing to compare the bench with: give the rig.toml of zeromethod calibrate"
)


@click.command(
    "check", epilog="Example: zeromethod check --rig my.toml --display 1 --camera 0 --press-depth 0.2"
)
@rig_option()
@bench_options
@click.option(
    "--press-depth",
    "press_depth_mm",
    type=Real(min=0, min_open=True),
    metavar="MM",
    help="Ask for one press of this depth, and compare.",
)
@click.option(
    "--depth-sigma",
    "press_sigma_mm",
    type=Real(min=0, min_open=True),
    default=1e-3,
    show_default=True,
    metavar="MM",
    help="How well that depth is known.",
)
@scenario_options
@summary_option
def check_command(
    rig_name: str,
    press_depth_mm: float | None,
    press_sigma_mm: float,
    scenario: str | None,
    seed: int | None,
    summary: Path | None,
    **others: Any,
) -> None:
    """Check that the bench is still the one that was calibrated: light, delay, rest, frames, a known press.

    The verdict is good, drifted (by how much, what that means for depth), not fit to measure, or calibrate
    again; anything but good ends with exit code 1. A dated line is added to checks.csv next to the
    calibration.
    """
    rig = with_devices(given_rig(rig_name), BenchOptions(**others))
    check_simulated(rig.camera.driver in REAL_CAMERAS, scenario, seed)
    rig = with_given(rig, scenario or ("none" if press_depth_mm is None else None), simulation={"seed": seed})
    check_geometry(rig)
    if press_depth_mm is not None:
        check_depths(rig, (press_depth_mm,), "--press-depth")
    say_simulated(rig)
    log = log_of(rig_name)
    stored = calibration_of(rig_name)
    limit_threads()
    try:
        with folder_for("--rig", log.parent), opened_devices(rig) as devices:
            if stored is not None:
                check_calibration(stored, rig_name, rig, devices)
            elif not is_known(rig, devices.camera):
                raise InputError(f"--rig: {rig_name}: {NEVER}")
            found = check_bench(
                rig,
                devices,
                press_depth_mm=press_depth_mm,
                press_sigma_mm=press_sigma_mm,
                warning=None if stored is None else stored.age_warning(),
                prompts=TerminalPrompts(),
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted: nothing was kept") from None
    _report(found, log, summary)


def _report(found: DailyCheck, log: Path, summary: Path | None) -> None:
    """Print, keep, and turn the verdict into an exit code."""
    console = Console(highlight=False)
    rows = [(one.subject.value, one.fitness.value, one.words) for one in found.findings]
    console.print(text_table(("what", "verdict", "measured"), rows, left=(0, 1, 2)))
    with writing("--rig", log):
        append_check(log, found)
    console.print(f"kept in {log}", soft_wrap=True)
    write_summary(
        summary,
        {
            "rig": found.rig,
            "time": found.time.isoformat(),
            "fitness": found.fitness.value,
            "verdict": found.verdict,
            "findings": {one.subject.value: [one.fitness.value, one.words] for one in found.findings},
            **found.figures,
        },
    )
    if found.fitness is not Fitness.GOOD:
        raise MeasurementError(f"check: {found.verdict}")
    console.print(found.verdict)
