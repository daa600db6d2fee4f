"""`zeromethod calibrate weight`: how stiff the rubber is, by a weight put on the mirror."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from zeromethod.calibration.folder import calibration_of
from zeromethod.cli.calibrate_options import patience_option
from zeromethod.cli.calibrated_bench import check_calibration
from zeromethod.cli.device_options import (
    REAL_CAMERAS,
    BenchOptions,
    bench_options,
    check_simulated,
    given_rig,
    opened_devices,
    say_simulated,
    scenario_options,
    with_devices,
    with_given,
)
from zeromethod.cli.numbers import Real
from zeromethod.cli.output import check_file, summary_option, write_summary
from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.state import State
from zeromethod.optics import check_geometry
from zeromethod.rig.model import SIMULATED, Rig
from zeromethod.rig.save import save_values
from zeromethod.session.session import Session
from zeromethod.session.trust import is_known
from zeromethod.session.weighing import MOST_GRAMS, ModulusBefore, Weighed, check_weight, for_weighing, weigh
from zeromethod.thread_limits import limit_threads

_SIMULATED = "weight"
"""What presses a simulated bench unless a scenario is given."""
_MOST_SIGMAS = 3.0
"""Change of a stored modulus, of both sigmas, above which chance does not explain it."""


@click.command(
    "weight", epilog="Example: zeromethod calibrate weight --rig my.toml --grams 20 --grams-sigma 0.02"
)
@click.option("--rig", "rig_name", required=True, help="Your rig file: it takes the modulus.")
@bench_options
@click.option(
    "--grams",
    type=Real(0, MOST_GRAMS, min_open=True),
    required=True,
    help="All that will rest on the mirror, g.",
)
@click.option(
    "--grams-sigma",
    "sigma_grams",
    type=Real(min=0, min_open=True),
    default=0.1,
    show_default=True,
    metavar="G",
    help="How well that is known (standard deviation).",
)
@patience_option("Longest wait for the mirror at rest, and for the weight.")
@scenario_options
@summary_option
def weight_command(
    rig_name: str,
    grams: float,
    sigma_grams: float,
    patience_s: float,
    scenario: str | None,
    seed: int | None,
    summary: Path | None,
    **devices: Any,
) -> None:
    """Young's modulus of the rubber, from a known weight on a calibrated bench's mirror.

    Mirror upwards and level. Nothing may touch it until the weight is asked for; then nothing else may. What
    is found is written into the rig file, as youngs_modulus_mpa of [rubber].
    """  # fmt: skip
    check_weight(grams, sigma_grams)
    path = _own_file(rig_name)
    rig = with_devices(given_rig(rig_name), BenchOptions(**devices))
    check_simulated(rig.camera.driver in REAL_CAMERAS, scenario, seed)
    if scenario is None and rig.camera.driver == SIMULATED:
        scenario = _SIMULATED
    rig = with_given(rig, scenario, simulation={"seed": seed})
    check_geometry(rig)
    say_simulated(rig)
    limit_threads()
    try:
        found = _weigh(rig, rig_name, (grams, sigma_grams, patience_s))
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted: nothing was stored") from None
    before = ModulusBefore.of(rig.rubber, found)
    for line in _words(found, before):
        click.echo(line)
    if before is not None and abs(before.off_sigmas) > _MOST_SIGMAS:
        click.echo("! not the rubber that the rig file had: are --grams and its [rubber] right?", err=True)
    try:
        save_values(path, found.rig_values)
        click.echo(f"stored as rubber.youngs_modulus_mpa, rubber.youngs_modulus_sigma_mpa in {path}")
    finally:
        write_summary(summary, _figures(found, before))


def _own_file(rig_name: str) -> Path:
    """The rig file, which can be written."""
    path = Path(rig_name)
    if not path.is_file():
        given_rig(rig_name)  # says so where there is no such rig
        raise InputError(f"--rig: {rig_name}: a rig file of your own, which takes the modulus")
    check_file("--rig", path, path.suffix.lower())
    return path


def _weigh(rig: Rig, rig_name: str, weighing: tuple[float, float, float]) -> Weighed:
    """Open the bench and weigh; grams, their sigma and patience as for `weigh`."""
    with opened_devices(rig) as opened:
        stored = calibration_of(rig_name)
        if stored is not None:
            check_calibration(stored, rig_name, rig, opened)
        elif not is_known(rig, opened.camera):
            raise InputError(
                f"--rig: {rig_name}: not calibrated: zeromethod calibrate --rig {rig_name} first"
            )
        with Session(for_weighing(rig), devices=opened) as session, closing(session.run()) as steps:
            try:
                return weigh(steps, *weighing, lambda words: click.echo(words, err=True))
            except MeasurementError:
                if session.result.interrupted:
                    raise KeyboardInterrupt from None
                if (status := session.loop.status).state is State.FAULT:
                    raise MeasurementError(f"weight: {status.reason}") from None
                raise


def _words(found: Weighed, before: ModulusBefore | None) -> list[str]:
    causes = ", ".join(f"{name} {share:.2%}" for name, share in found.sigma_share.items())
    where = "1 contact" if found.contacts == 1 else f"{found.contacts} contacts"
    true = "" if math.isnan(found.true_force_n) else f"; truly {found.true_force_n:.4g} N"
    lines = [
        f"Young's modulus {found.youngs_modulus_mpa:.4g} MPa, sigma {found.sigma_mpa:.2g} MPa ({causes})",
        f"  by {found.weight_n:.4g} N on {where}{true}",
    ]
    if before is not None:
        change = found.youngs_modulus_mpa - before.youngs_modulus_mpa
        lines.append(
            f"  was {before.youngs_modulus_mpa:.4g} ± {before.sigma_mpa:.2g} MPa: now {change:+.2g} MPa, "
            f"{abs(before.off_sigmas):.1f} of both sigmas"
        )
    return lines


def _figures(found: Weighed, before: ModulusBefore | None) -> dict[str, Any]:
    return {
        "youngs_modulus_mpa": found.youngs_modulus_mpa,
        "sigma_mpa": found.sigma_mpa,
        "weight_n": found.weight_n,
        "contacts": found.contacts,
        "sigma_share": found.sigma_share,
        "before": None if before is None else asdict(before),
        "truth": None if math.isnan(found.true_force_n) else {"force_n": found.true_force_n},
    }
