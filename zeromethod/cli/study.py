"""`zeromethod study`: many runs over a grid or a Monte Carlo of settings."""

from __future__ import annotations

import time
from pathlib import Path

import click

from zeromethod.cli.numbers import Whole
from zeromethod.cli.output import check_file, check_folder, write_summary
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError, MeasurementError
from zeromethod.study import (
    Cluster,
    LocalPool,
    Results,
    Standing,
    Study,
    conduct,
    load_study,
    packaged_studies,
)
from zeromethod.study.conduct import TABLE
from zeromethod.study.pool import cores
from zeromethod.study.resume import JOURNAL
from zeromethod.view.progress import Advance, progress

FIGURE = "figure.png"

_TOLD = 10
"""Failed runs that are told one by one."""


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
@click.option("--again", is_flag=True, help="Do runs again that failed.")
@click.option("--anew", is_flag=True, help="Begin anew: forget the runs in the folder.")
@click.option("--summary", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures (.json).")
def study_command(
    file: str | None,
    output: Path | None,
    workers: int | None,
    cluster: str | None,
    again: bool,
    anew: bool,
    summary: Path | None,
) -> None:
    """Carry out the runs that FILE asks for, on every core, and put their figures into one table.

    FILE is a study file (.toml), or the name of a packaged study; without one, these are listed. Writes
    table.parquet and figure.png. A study that was interrupted goes on where it stood when the same command
    is given again.
    """
    if file is None:
        for name in packaged_studies():
            click.echo(f"{name:16} {load_study(name).table.title}")
        return
    check_file("--summary", summary, suffix=".json")
    if cluster is not None and workers is not None:
        raise InputError(f"--workers: {workers}: not with --cluster, which has its own")
    if again and anew:
        raise InputError("--again: not with --anew, which does every run")
    study = load_study(file)
    folder = output or Path(f"study-{study.name}")
    executor = _executor(cluster, workers, begun=(folder / JOURNAL).exists() and not anew)
    check_folder("--output", folder)
    started = time.monotonic()
    told = None
    try:
        with stopped_by_signals(), progress(study.count, "runs") as advance:
            told = _Told(advance)
            results = conduct(study, folder, executor, anew=anew, again=again, on_standing=told, tell=_say)
    except (KeyboardInterrupt, MeasurementError):
        kept = told.words if told is not None else "the runs done before"
        click.echo(f"{kept} are kept in {folder}; the same command goes on from there", err=True)
        raise
    seconds = time.monotonic() - started
    _report(study, results, folder, summary, seconds)


def _executor(cluster: str | None, workers: int | None, *, begun: bool) -> Cluster | LocalPool:
    """Whoever carries out the runs; begun: there may be nothing left to do, and no cluster any more."""
    if cluster is None:
        return LocalPool(workers)
    executor = Cluster(cluster, _say)
    if not begun:
        # an address that is wrong makes no folder, and forgets no runs
        executor.check()
    return executor


def _say(line: str) -> None:
    click.echo(f"! {line}", err=True)


class _Told:
    """How far the study is, for the bar and for who stops it."""

    def __init__(self, advance: Advance) -> None:
        self._advance = advance
        self._standing: Standing | None = None
        self._shown = 0

    def __call__(self, standing: Standing) -> None:
        self._standing = standing
        for _ in range(standing.done - self._shown):
            self._advance(f"runs, {standing.failed} failed" if standing.failed else "runs")
        self._shown = standing.done

    @property
    def words(self) -> str:
        """How many runs are done."""
        if self._standing is None:
            return "the runs done before"
        return f"{self._standing.done} of {self._standing.total} runs"


def _report(study: Study, results: Results, folder: Path, summary: Path | None, seconds: float) -> None:
    """Draw the picture, say what was found, and turn failed runs into an exit code."""
    from zeromethod.view.study_figure import draw_study  # noqa: PLC0415 - matplotlib loads slowly

    failures = results.failures
    draw_study(study, results.rows, folder / FIGURE)
    if summary is not None:
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
    for row in failures[:_TOLD]:
        settings = ", ".join(f"{key} = {row[key]}" for key in study.varied)
        click.echo(f"run {row['run']}, seed {row['seed']}, {settings}: {row['failure']}", err=True)
    if len(failures) > _TOLD:
        click.echo(f"and {len(failures) - _TOLD} more: see the column failure of the table", err=True)
    if failures:
        raise MeasurementError(
            f"{len(failures)} of {len(results.rows)} runs failed (--again does them again)"
        )
