"""What every benchmark with bars shares: its command line, figures and bars, exit code and JSON file."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.salt import held_out
from zeromethod.cli.main import main
from zeromethod.cli.output import summary_option, wide_console, write_summary
from zeromethod.thread_limits import limit_threads
from zeromethod.view.table import text_table


@dataclass(frozen=True)
class Figure:
    """One figure and its bar. met None: given for comparison, without a bar.

    number, error: what `make bars` judges, and its standard error, NaN where not known. least, most: the
    bar, of the same figure of another version where `of_other`.
    """

    name: str
    value: str
    bar: str = ""
    met: bool | None = None
    number: float | None = None
    error: float = float("nan")
    least: float | None = None
    most: float | None = None
    of_other: bool = False


def figure(
    name: str,
    number: float,
    error: float = float("nan"),
    *,
    unit: str = "",
    least: float | None = None,
    most: float | None = None,
    of_other: bool = False,
) -> Figure:
    """A number and what it is held against. unit "%": of 1."""
    times, unit = (100.0, " %") if unit == "%" else (1.0, unit and f" {unit}")

    def words(value: float, digits: int = 4) -> str:
        return f"{times * value:.{digits}g}"

    value = words(number) + (f" ± {words(error, 2)}" if np.isfinite(error) else "") + unit
    if of_other:
        times, unit = 1.0, " of another version's"
    ends = "" if least is None else f">= {words(least)}", "" if most is None else f"<= {words(most)}"
    bar = ", ".join(filter(None, ends))
    judge = bool(bar) and not of_other
    met = bool((least is None or number >= least) and (most is None or number <= most)) if judge else None
    return Figure(name, value, bar and bar + unit, met, number, error, least, most, of_other)


@dataclass(frozen=True)
class Report:
    """Figures with bars, a table of details under them (header first), and all numbers for the JSON file.

    totals: whether these, too, are of many scenes each, and not left out where scenes are held out.
    """

    title: str
    figures: Sequence[Figure]
    details: Sequence[Sequence[str]]
    data: dict[str, Any]
    totals: bool = False

    @property
    def met(self) -> bool:
        """Whether no bar was missed."""
        return all(figure.met is not False for figure in self.figures)


def benchmark(name: str, doc: str | None, *more: Callable[[Any], Any]) -> Callable[..., click.Command]:
    """Make a command of what measures: it gets --quick and the options in `more`, and returns its report.

    doc: the module's, printed by --help. A figure that misses its bar makes the exit code 1.
    """

    def make(measure: Callable[..., Report | None]) -> click.Command:
        example = f"Example: python -m benchmarks.{name} --quick --summary {name}.json"

        @click.command(name, help=doc, epilog=example)
        @click.option("--quick", is_flag=True, help="Fewer runs, frames or benches; the same bars.")
        @summary_option
        def command(summary: Path | None, **given: Any) -> None:
            limit_threads()
            report = measure(**given)
            if report is not None:
                click.get_current_context().exit(finish(report, summary))

        for option in more:
            command = option(command)
        return command

    return make


def start(command: click.Command) -> None:
    """Run a benchmark from the shell: bad input is one line and exit code 2, as for `zeromethod`."""
    main(command=command, name=f"python -m benchmarks.{command.name}")


def finish(report: Report, json_file: Path | None = None) -> int:
    """Print the report, write the JSON file if one is asked for; exit code 1 when a bar was missed.

    Of held-out scenes only totals.
    """
    if held_out() and not report.totals:
        report = replace(report, details=(), data={})
    console = wide_console(250)
    console.print(f"{report.title}\n")
    if report.details:
        console.print(text_table(report.details[0], report.details[1:]))
        console.print()
    words = {True: "met", False: "MISSED", None: ""}
    rows = [(f.name, f.value, f.bar, words[f.met]) for f in report.figures]
    console.print(text_table(("figure", "value", "bar", ""), rows))
    if json_file is not None:
        about = {"python": platform.python_version(), "zeromethod": version("zeromethod")}
        figures = [asdict(figure) for figure in report.figures]
        whole = {"title": report.title, "met": report.met, "figures": figures, "data": report.data, **about}
        write_summary(json_file, whole)
    return 0 if report.met else 1
