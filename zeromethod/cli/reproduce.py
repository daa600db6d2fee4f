"""`zeromethod reproduce`: the paper's figures and tables, next to what the zero method gives."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from zeromethod.cli.output import check_folder, summary_option, write_summary
from zeromethod.errors import MeasurementError
from zeromethod.paper.reproduce import STEPS, Reproduction, reproduce
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress
from zeromethod.view.reproduce_table import needle_table, press_notes, press_table


@click.command(
    "reproduce", epilog="Example: zeromethod reproduce --output out/reproduce --summary reproduce.json"
)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("out/reproduce"),
    show_default=True,
    help="Folder for the pictures.",
)
@summary_option
@click.option("--quick", is_flag=True, help="Fewer press positions and frames.")
def reproduce_command(output: Path, summary: Path | None, quick: bool) -> None:
    """Do the paper again on the simulated bench: its needle (section 3.1) and its press (section 5).

    The press is read by the paper's own method, by all pixels of the same images, and by the zero method.
    Writes figures 5 to 9 and 13 to 15.
    """
    check_folder("--output", output)
    limit_threads()
    with progress(len(STEPS) + 1, STEPS[0]) as advance:
        found = reproduce(lambda name: advance(name or "drawing the pictures"), quick=quick)
        pictures = _draw(found, output)
        advance("")
    figures = found.figures()
    console = Console()
    console.print(needle_table(figures["needle"]))
    console.print(press_table(figures))
    for note in press_notes(figures):
        console.print(note, soft_wrap=True, highlight=False)
    console.print(f"pictures: {output} ({', '.join(path.name for path in pictures)})", soft_wrap=True)
    write_summary(summary, figures)
    for name in ("whole_image", "zero_method"):
        reason = figures["press"][name]["reason"]
        if reason:
            raise MeasurementError(f"{name.replace('_', ' ')}: {reason}")


def _draw(found: Reproduction, folder: Path) -> list[Path]:
    from zeromethod.view.paper_figures import draw_needle_figures, draw_press_figures  # noqa: PLC0415 - matplotlib

    return [
        *draw_needle_figures(found.needle, folder),
        *draw_press_figures(found.before, found.after, found.whole, found.truth_along_line(), folder),
    ]
