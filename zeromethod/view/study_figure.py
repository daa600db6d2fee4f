"""The picture of a study: one column of its table over another, a line for each value of others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from zeromethod.arrays import Float
from zeromethod.study.plan import FigureTable, Study
from zeromethod.study.results import Row
from zeromethod.view.axes import picture, plain_log_ticks

_STYLES = ("-", "--", ":", "-.")
_MOST_LINES = 40


def draw_study(study: Study, rows: Sequence[Row], path: Path) -> None:
    """Write the figure that the study file asks for (a fitting one where it asks for none) as PNG."""
    table = study.table.figure or default_figure(study, rows)
    xs = _values(rows, table.x)
    words = any(isinstance(x, str) for x in xs)
    with picture(path, (9.4 if table.hue else 7.0, 5.5), study.table.title, font=9) as figure:
        axis = figure.subplots()
        for line, (style, colour) in _looks(rows, table.hue).items():
            of_line = [row for row in rows if tuple(row[hue] for hue in table.hue) == line]
            places, (low, middle, high) = _spread(of_line, table, xs, words=words)
            if places.size:
                name = ", ".join(_named(*one) for one in zip(table.hue, line, strict=True))
                axis.plot(places, middle, "o", linestyle=style, color=colour, markersize=4, label=name)
                axis.fill_between(places, low, high, color=colour, alpha=0.2, linewidth=0)
        _scale(axis, table, xs, words=words)
        axis.set(xlabel=table.x, ylabel=table.y)
        axis.grid(alpha=0.3, which="both")
        if table.hue and axis.lines:
            figure.legend(loc="outside right center", fontsize=8)
        failed = sum(row["failure"] is not None for row in rows)
        counted = f"{len(rows)} runs" + (f", {failed} of them failed" if failed else "")
        figure.supxlabel(counted, fontsize=8, color="0.3")


def _scale(axis: Axes, table: FigureTable, xs: Sequence[Any], *, words: bool) -> None:
    if words:
        axis.set_xticks(range(len(xs)), [str(x) for x in xs], rotation=30, ha="right")
    if table.scale != "linear":
        axis.set_yscale("log")
        plain_log_ticks(axis.yaxis)
    if table.scale == "loglog" and not words:
        axis.set_xscale("log")
        plain_log_ticks(axis.xaxis)


def _looks(rows: Sequence[Row], hues: Sequence[str]) -> dict[tuple[Any, ...], tuple[str, str]]:
    """Style and colour of each line, by the values of its hues.

    One style for each value of the first hue where there are several, one colour for each of the others.
    """
    lines = list(dict.fromkeys(tuple(row[hue] for hue in hues) for row in rows))[:_MOST_LINES]
    split = int(len(hues) > 1)
    styles, colours = ({line[part]: None for line in lines} for part in (slice(split), slice(split, None)))
    return {
        line: (
            _STYLES[list(styles).index(line[:split]) % len(_STYLES)],
            f"C{list(colours).index(line[split:]) % 10}",
        )
        for line in lines
    }


def default_figure(study: Study, rows: Sequence[Row]) -> FigureTable:
    """A figure for a study that names none: the first numeric metric over the last key of the grid."""
    metrics = list(rows[0])[3 + len(study.varied) : -1]
    y = next((name for name in metrics if np.isfinite(_numbers(rows, name)).any()), metrics[0])
    axes = [key for key, values in study.axes.items() if len(values) > 1]
    x = axes.pop() if axes else next(iter(study.table.random), "run")
    return FigureTable(x=x, y=y, hue=tuple(axes[-2:]))


def _spread(
    rows: Sequence[Row], table: FigureTable, xs: Sequence[Any], *, words: bool
) -> tuple[Float, Float]:
    """Places along x, and y there (3, places): 16 %, median and 84 %; failed runs are left out."""
    places, spreads = [], []
    for number, x in enumerate(xs):
        values = _numbers([row for row in rows if row[table.x] == x], table.y)
        values = values[np.isfinite(values)]
        if values.size:
            places.append(number if words else x)
            spreads.append(np.percentile(values, (16, 50, 84)))
    return np.array(places, dtype=np.float64), np.array(spreads).reshape(-1, 3).T


def _values(rows: Sequence[Row], column: str) -> list[Any]:
    """Values of a column: numbers rising, words in the order in which they come."""
    found = list(dict.fromkeys(row[column] for row in rows if row[column] is not None))
    return found if any(isinstance(value, str) for value in found) else sorted(found)


def _numbers(rows: Sequence[Row], column: str) -> Float:
    values = (row[column] for row in rows)
    return np.array(
        [float(value) if isinstance(value, int | float) else np.nan for value in values], dtype=np.float64
    )


def _named(column: str, value: Any) -> str:
    """A value with its column's name; words speak for themselves."""
    if isinstance(value, str):
        return value
    return f"{column} {value:.4g}" if isinstance(value, float) else f"{column} {value}"
