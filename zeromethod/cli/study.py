"""`zeromethod study`: many runs over a grid or a Monte Carlo of settings."""

from __future__ import annotations

import time
from pathlib import Path

import click

from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import check_folder, summary_option, write_summary
from zeromethod.errors import InputError, MeasurementError
from zeromethod.study import Progress, Results, Study, Workers, load_study, packaged_studies, run_study
from zeromethod.study.journal import JOURNAL
from zeromethod.study.results import TABLE
from zeromethod.study.workers import cores
from zeromethod.view.progress import progress

FIGURE = "figure.png"

_LISTED = 10
"""Failed runs that are listed one by one."""


@click.command(
    "study", epilog="Example: zeromethod study gain-delay, then zeromethod study my-study.toml --output runs"
)
@click.argument("file", metavar="[FILE]", required=False)
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results.  [default: study-NAME]",
)
@click.option("--workers", type=Whole(min=1), help="Processes.  [default: one per core]")
@click.option("--cluster", metavar="ADDRESS", help="Run on a Dask cluster: its scheduler's tcp://host:8786.")
@click.option("--retry-failed", is_flag=True, help="Do the runs again that failed.")
@click.option("--restart", is_flag=True, help="Begin again: forget the runs in the folder.")
@summary_option
def study_command(
    file: str | None,
    output: Path | None,
    workers: int | None,
    cluster: str | None,
    retry_failed: bool,
    restart: bool,
    summary: Path | None,
) -> None:
    """Carry out the runs that FILE asks for, on every core, and put their figures into one table.

    FILE is a study file (.toml), or the name of a packaged study; without one, these are listed. Writes
    table.parquet and figure.png. The same command given again resumes a study that was interrupted.
    """
    if file is None:
        for name in packaged_studies():
            click.echo(f"{name:16} {load_study(name).table.title}")
        return
    if cluster is not None and workers is not None:
        raise InputError(f"--workers: {workers}: not with --cluster, which has its own")
    if retry_failed and restart:
        raise InputError("--retry-failed: not with --restart, which does every run")
    study = load_study(file)
    folder = output or Path(f"study-{study.name}")
    pool = Workers(workers, cluster, _report)
    if restart or not (folder / JOURNAL).exists():
        # a wrong address creates no folder and forgets no runs; where all runs are done, none is needed
        pool.check()
    check_folder("--output", folder)
    started = time.monotonic()
    kept = "the runs done before"
    try:
        with progress(study.count, "runs") as advance:

            def show(now: Progress) -> None:
                nonlocal kept
                kept = f"{now.done} of {now.total} runs"
                for _ in range(now.done if now.outcome is None else 1):
                    advance(f"runs, {now.failed} failed" if now.failed else "runs")

            results = run_study(
                study,
                folder,
                pool,
                restart=restart,
                retry_failed=retry_failed,
                on_progress=show,
                report=_report,
            )
    except (KeyboardInterrupt, MeasurementError):
        click.echo(f"{kept} are kept in {folder}; the same command goes on from there", err=True)
        raise
    _finish(study, results, folder, summary, time.monotonic() - started)


def _report(line: str) -> None:
    click.echo(f"! {line}", err=True)


def _finish(study: Study, results: Results, folder: Path, summary: Path | None, seconds: float) -> None:
    """Draw the picture, print what was found, and turn failed runs into an exit code."""
    from zeromethod.view.study_figure import draw_study  # noqa: PLC0415 - matplotlib loads slowly

    failures = results.failures
    draw_study(study, results.rows, folder / FIGURE)
    write_summary(
        summary,
        {
            "study": study.name,
            "title": study.table.title,
            "procedure": study.table.procedure,
            "seed": study.table.seed,
            "runs": len(results.rows),
            "runs_from_before": results.before,
            "failed": len(failures),
            "failures": failures,
            "seconds": seconds,
            "cores": cores(),
            "table": str(folder / TABLE),
            "figure": str(folder / FIGURE),
        },
    )
    before = f", {results.before} of them from before" if results.before else ""
    click.echo(f"{study.table.title}: {len(results.rows)} runs{before}, {len(failures)} failed")
    click.echo(f"wrote {folder / TABLE} and {folder / FIGURE}")
    for row in failures[:_LISTED]:
        settings = ", ".join(f"{key} = {row[key]}" for key in study.varied)
        click.echo(f"run {row['run']}, seed {row['seed']}, {settings}: {row['failure']}", err=True)
    if len(failures) > _LISTED:
        click.echo(f"and {len(failures) - _LISTED} more: see the column failure of the table", err=True)
    if failures:
        raise MeasurementError(
            f"{len(failures)} of {len(results.rows)} runs failed (--retry-failed does them again)"
        )
