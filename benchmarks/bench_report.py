"""What every accuracy benchmark prints: figures beside their bars; its exit code and JSON file."""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TaskID
from rich.table import Table


@dataclass(frozen=True)
class Figure:
    """One figure beside its bar. met None: stands beside for comparison, has no bar."""

    name: str
    value: str
    bar: str = ""
    met: bool | None = None


@dataclass(frozen=True)
class Report:
    """Figures with bars, a table of details under them (header first), and all numbers for the JSON file."""

    title: str
    figures: Sequence[Figure]
    details: Sequence[Sequence[str]]
    data: dict[str, Any]

    @property
    def met(self) -> bool:
        """Whether no bar was missed."""
        return all(figure.met is not False for figure in self.figures)


def options(doc: str | None, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse --quick and --json."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer runs or frames; the same bars")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
    return parser.parse_args(arguments)


class Bar:
    """Progress on stderr when that is a terminal, else nothing."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def step(self, count: int = 1) -> None:
        """Go on by `count`."""
        self._progress.advance(self._task, count)


@contextmanager
def progress(total: int, what: str) -> Iterator[Bar]:
    """Bar over `total` steps; gone when done."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as shown:
        yield Bar(shown, shown.add_task(what, total=total))


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(box=None, pad_edge=False)
    for index, name in enumerate(header):
        table.add_column(name, justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def finish(report: Report, json_file: Path | None = None) -> int:
    """Print the report, write the JSON file if one is asked for; exit code 1 when a bar was missed."""
    console = Console(width=None if sys.stdout.isatty() else 250, highlight=False)
    console.print(f"{report.title}\n")
    if report.details:
        console.print(_table(report.details[0], report.details[1:]))
        console.print()
    words = {True: "met", False: "MISSED", None: ""}
    rows = [(f.name, f.value, f.bar, words[f.met]) for f in report.figures]
    console.print(_table(("figure", "value", "bar", ""), rows))
    if json_file is not None:
        about = {"python": platform.python_version(), "zeromethod": version("zeromethod")}
        figures = [asdict(figure) for figure in report.figures]
        whole = {"title": report.title, "met": report.met, "figures": figures, "data": report.data, **about}
        json_file.write_text(json.dumps(whole, indent=2) + "\n")
    return 0 if report.met else 1
