"""`python -m benchmarks.against_peers`: speed and accuracy against the peers and the bounds."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from benchmarks.against_peers import PARTS, bars, run_parts, steps
from benchmarks.against_peers.table import peers_table
from zeromethod.cli.main import main
from zeromethod.cli.output import check_file, write_summary
from zeromethod.thread_limits import limit_threads
from zeromethod.view.progress import progress


@click.command(
    "against_peers",
    epilog="Example: python -m benchmarks.against_peers --part displacement --figure bench.png",
)
@click.option(
    "--part", "parts", multiple=True, type=click.Choice(list(PARTS)), help="Only this part; may be repeated."
)
@click.option("--quick", is_flag=True, help="Smaller frames, fewer rounds: half a minute.")
@click.option("--figure", type=click.Path(path_type=Path, dir_okay=False), help="Write a picture (.png).")
@click.option("--summary", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures (.json).")
def command(parts: tuple[str, ...], quick: bool, figure: Path | None, summary: Path | None) -> None:
    """Measure this system, its peers and the physical bound: time, error, memory, one thread each.

    Everything is measured in this run on the same frames; compare ratios, not milliseconds. The part "why"
    compares open loop with null; its picture is written next to --figure, as NAME-open-loop.png.
    """
    check_file("--figure", figure, suffix=".png")
    check_file("--summary", summary, suffix=".json")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does: everything is kept
    limit_threads()
    chosen = [part for part in PARTS if part in parts or not parts]
    figures: dict[str, Any] = {}
    try:
        with progress(steps(chosen, quick), "bench") as advance:
            run_parts(figures, chosen, advance, quick)
    finally:
        if figures:
            _report(figures, figure, summary)


def _report(figures: dict[str, Any], figure: Path | None, summary: Path | None) -> None:
    """Print the tables and write what was asked for, of whatever is measured by now."""
    figures["figures"] = bars(figures)
    console = Console(width=None if sys.stdout.isatty() else 120)
    host = figures["host"]
    console.print(
        f"{host['machine']}, {host['cores']} cores, {host['threads']} thread, OpenCV {host['opencv']}, "
        f"numpy {host['versions']['numpy']}; one reading each, same frames\n",
        highlight=False,
    )
    console.print(peers_table(figures, figures["figures"]))
    why = figures.get("why")
    if why:
        from benchmarks.against_peers.open_loop_figure import draw_open_loop, open_loop_table  # noqa: PLC0415 - matplotlib

        console.print()
        console.print(open_loop_table(why))
    if summary is not None:
        write_summary(summary, figures)
    if figure is not None:
        from benchmarks.against_peers.figure import draw_peers  # noqa: PLC0415 - matplotlib loads slowly

        draw_peers(figures, figure)
        if why:
            draw_open_loop(why, figure.with_name(f"{figure.stem}-open-loop.png"))


if __name__ == "__main__":
    main(command=command, name="benchmarks.against_peers")
