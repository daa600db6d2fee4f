"""`zeromethod report`: a recording as one HTML page, or followed while it grows."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from zeromethod.cli.output import REPLACES, OutputFile, check_file, summary_option, write_summary, writing
from zeromethod.cli.recording_options import recording_argument
from zeromethod.cli.stopping import stopped_by_signals
from zeromethod.errors import InputError
from zeromethod.view.progress import progress


@click.command("report", epilog="Example: zeromethod report press.h5 --output press.html")
@recording_argument
@click.option(
    "--output",
    type=OutputFile(".html"),
    help=f"Write the page here (.html). {REPLACES}  [default: FILE with this suffix]",
)
@click.option("--follow", "following", is_flag=True, help="Show how FILE grows while it is recorded.")
@summary_option
def report_command(file: Path, output: Path | None, following: bool, summary: Path | None) -> None:
    """One recording as one HTML page that needs nothing else.

    FILE may still be written, or have been cut off. --follow shows state, rate, residual and peak depth in
    the terminal instead, until the recording ends or Ctrl-C; a FILE that is not there yet is waited for.
    """
    with stopped_by_signals():
        if following:
            for option, value in (("--output", output), ("--summary", summary)):
                if value is not None:
                    raise InputError(f"--follow and {option}: give one of them, not both")
            _follow(file)
        else:
            if output is None:
                output = file.with_suffix(".html")
                check_file("--output", output, suffix=".html")
            _write(file, output, summary)


def _follow(file: Path) -> None:
    from zeromethod.view.follow import follow  # noqa: PLC0415 - the page needs more than the tail

    if not file.absolute().parent.is_dir():
        raise InputError(f"{file}: the folder {file.absolute().parent} does not exist")
    follow(file, Console())


def _write(file: Path, output: Path, summary: Path | None) -> None:
    from zeromethod.recording.damage import damaged_words  # noqa: PLC0415
    from zeromethod.recording.recording import Recording  # noqa: PLC0415
    from zeromethod.view.report import STEPS, write_report  # noqa: PLC0415 - matplotlib loads slowly

    with (
        Recording(file) as recording,
        progress(len(STEPS), first=STEPS[0]) as advance,
        writing("--output", output),
    ):
        figures = write_report(recording, file, output, advance)
        origin = recording.tables.origin_words()
    write_summary(summary, {"recording": str(file), "report": str(output), **figures})
    for words in filter(None, (damaged_words(figures["damaged"]), origin)):
        click.echo(f"! {file}: {words}", err=True)
    click.echo(f"written: {output}")
