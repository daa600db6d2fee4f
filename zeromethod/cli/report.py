"""`zeromethod report`: a recording as one HTML page, or followed while it grows."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from zeromethod.cli.output import check_file, write_summary, writing
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError
from zeromethod.view.progress import progress


@click.command("report", epilog="Example: zeromethod report press.h5 --output press.html")
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the page here (.html).  [default: beside FILE, with its name]",
)
@click.option("--follow", "following", is_flag=True, help="Tell how FILE goes on while it is recorded.")
@click.option("--summary", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures (.json).")
def report_command(file: Path, output: Path | None, following: bool, summary: Path | None) -> None:
    """One recording as one HTML page that needs nothing else.

    FILE may still be written, or have been cut off. --follow tells state, rate, residual and peak depth in
    the terminal instead, until the recording ends or Ctrl-C; a FILE that is not there yet is waited for.
    """
    if file.is_dir():
        raise InputError(f"{file}: is a folder: a recording (HDF5)")
    with stopped_by_signals():
        if following:
            for option, value in (("--output", output), ("--summary", summary)):
                if value is not None:
                    raise InputError(f"--follow and {option}: give one of them, not both")
            _follow(file)
        else:
            _write(file, output or file.with_suffix(".html"), summary)


def _follow(file: Path) -> None:
    from zeromethod.view.follow import follow  # noqa: PLC0415 - the page needs more than the tail

    if not file.absolute().parent.is_dir():
        raise InputError(f"{file}: the folder {file.absolute().parent} does not exist")
    follow(file, Console())


def _write(file: Path, output: Path, summary: Path | None) -> None:
    check_file("--output", output, suffix=".html")
    check_file("--summary", summary, suffix=".json")
    from zeromethod.recording.damage import damaged_words  # noqa: PLC0415
    from zeromethod.recording.recording import Recording  # noqa: PLC0415
    from zeromethod.view.report import STEPS, write_report  # noqa: PLC0415 - matplotlib loads slowly

    with (
        Recording(file) as recording,
        progress(len(STEPS), first=STEPS[0]) as advance,
        writing("--output", output),
    ):
        figures = write_report(recording, file, output, advance)
    if summary is not None:
        write_summary(summary, {"recording": str(file), "report": str(output), **figures})
    if words := damaged_words(figures["damaged"]):
        click.echo(f"! {file}: {words}", err=True)
    click.echo(f"written: {output}")
