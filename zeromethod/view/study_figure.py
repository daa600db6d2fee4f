"""The picture of a study: maps, curves, bars or histograms of one column of its table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from zeromethod.arrays import Float, Mask
from zeromethod.study.plan import FigureTable, Study
from zeromethod.view.axes import plain_log_ticks

Row = dict[str, Any]

_FAILED = "0.55"
_LOW_PERCENT, _HIGH_PERCENT = 16, 84
_MOST_LINES = 10
_LEGEND_INCH = 2.4


def draw_study(study: Study, rows: Sequence[Row], path: Path) -> None:
    """Write the figure that the study file asks for (a fitting one where it asks for none) as PNG."""
    table = study.table.figure or default_figure(study, rows)
    panels = _values(rows, table.panels) if table.panels else [None]
    columns = min(len(panels), 3)
    lines = -(-len(panels) // columns)
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 10}):
        beside = table.kind == "curves" and bool(table.lines or table.reference)
        width = 1.8 + 5.2 * columns + (_LEGEND_INCH if beside else 0.0)
        figure = Figure(figsize=(width, 1.3 + 4.2 * lines), layout="constrained")
        axes = figure.subplots(lines, columns, squeeze=False, sharey=table.kind != "histogram").ravel()
        drawn: Any = None
        for axis, panel in zip(axes, panels, strict=False):
            chosen = [row for row in rows if panel is None or row[str(table.panels)] == panel]
            drawn = _KINDS[table.kind](axis, table, chosen, rows)
            if panel is not None:
                axis.set_title(_said(table, str(table.panels), panel))
        for axis in axes[len(panels) :]:
            axis.remove()
        if table.kind == "map" and drawn is not None:
            bar = figure.colorbar(drawn, ax=list(axes[: len(panels)]), label=_label(table, table.value))
            if table.value_scale == "log":
                plain_log_ticks(bar.ax.yaxis)
        if beside:
            _legend_beside(figure, list(axes[: len(panels)]))
        figure.suptitle(study.table.title, fontsize=12)
        if note := _note(table, rows):
            figure.supxlabel(note, fontsize=8, color="0.3")
        figure.savefig(path, dpi=120)


def default_figure(study: Study, rows: Sequence[Row]) -> FigureTable:
    """A figure for a study that names none: a map over two axes, curves over one, else a histogram.

    Of the first metric that is a number.
    """
    names = list(rows[0])
    metrics = names[3 + len(study.varied) : -1]
    value = next((name for name in metrics if np.isfinite(_numbers(rows, name)).any()), metrics[0])
    numeric = [key for key, values in study.axes.items() if len(values) > 1]
    if len(numeric) >= 2:
        x, y = numeric[-2:]
        panels = numeric[-3] if len(numeric) > 2 else None
        return FigureTable(kind="map", value=value, x=x, y=y, panels=panels)
    if len(numeric) == 1:
        return FigureTable(kind="curves", value=value, x=numeric[0])
    return FigureTable(kind="histogram", value=value)


def _map(axis: Axes, table: FigureTable, rows: Sequence[Row], every: Sequence[Row]) -> Any:
    """Medians as coloured cells; grey: failed or nothing to tell."""
    x_key, y_key = str(table.x), str(table.y)
    xs, ys = _values(every, x_key), _values(every, y_key)
    cells = np.array(
        [
            [_median([row for row in rows if row[x_key] == x and row[y_key] == y], table.value) for x in xs]
            for y in ys
        ]
    )
    known = _numbers(every, table.value)
    known = known[np.isfinite(known) & ((known > 0) | (table.value_scale == "linear"))]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    scale: Normalize = (
        LogNorm(low, high) if table.value_scale == "log" and known.size else Normalize(low, high)
    )
    name = "viridis_r" if table.good_below is not None else "viridis"
    colours = mpl.colormaps[name].with_extremes(bad=_FAILED)
    image = axis.imshow(np.ma.masked_invalid(cells), origin="lower", aspect="auto", norm=scale, cmap=colours)
    for i, j in np.ndindex(cells.shape):
        if cells.size <= 150:
            shown = f"{cells[i, j]:.2g}" if np.isfinite(cells[i, j]) else "-"
            dark = np.isfinite(cells[i, j]) and sum(colours(scale(cells[i, j]))[:3]) < 1.4
            axis.text(j, i, shown, ha="center", va="center", fontsize=7, color="w" if dark else "k")
    if table.good_below is not None:
        _border(axis, cells < table.good_below)
    axis.set_xticks(range(len(xs)), [_short(x) for x in xs], **_slanted(xs))
    axis.set_yticks(range(len(ys)), [_short(y) for y in ys])
    if table.reference is not None:
        _map_reference(axis, table, rows, xs, ys)
    axis.set_xlabel(_label(table, x_key))
    axis.set_ylabel(_label(table, y_key))
    return image


def _border(axis: Axes, good: Mask) -> None:
    """Line between cells that are good and cells that are not."""
    for i, j in np.ndindex(good.shape):
        if j + 1 < good.shape[1] and good[i, j] != good[i, j + 1]:
            axis.plot([j + 0.5, j + 0.5], [i - 0.5, i + 0.5], color="C3", linewidth=2)
        if i + 1 < good.shape[0] and good[i, j] != good[i + 1, j]:
            axis.plot([j - 0.5, j + 0.5], [i + 0.5, i + 0.5], color="C3", linewidth=2)


def _map_reference(
    axis: Axes, table: FigureTable, rows: Sequence[Row], xs: Sequence[Any], ys: Sequence[Any]
) -> None:
    """A column's median over x, in units of y, as a dashed line."""
    heights = np.array([_median([r for r in rows if r[str(table.x)] == x], str(table.reference)) for x in xs])
    # cells are drawn at equal distances, whatever their values; beyond them the line leaves the picture
    places = np.arange(len(ys), dtype=np.float64)
    at = np.interp(heights, np.asarray(ys, dtype=np.float64), places, right=len(ys) + 1.0, left=-2.0)
    axis.plot(range(len(xs)), at, "k--", linewidth=1.6)
    axis.set_ylim(-0.5, len(ys) - 0.5)


def _curves(axis: Axes, table: FigureTable, rows: Sequence[Row], every: Sequence[Row]) -> None:
    """Median over repeats with the range that two thirds of them fill."""
    x_key = str(table.x)
    chosen = _values(every, table.lines) if table.lines else [None]
    for number, line in enumerate(chosen[:_MOST_LINES]):
        on_line = [row for row in rows if line is None or row[str(table.lines)] == line]
        colour = f"C{number}"
        name = None if line is None else _said(table, str(table.lines), line)
        places, low, middle, high = _spread(on_line, x_key, table.value)
        if not places.size:
            continue
        axis.plot(places, middle, "o-", color=colour, markersize=4, label=name)
        if np.nanmax(high - low, initial=0.0) > 0:
            axis.fill_between(places, low, high, color=colour, alpha=0.2, linewidth=0)
        if table.reference is not None:
            at, _, beside, _ = _spread(on_line, x_key, table.reference)
            told = _label(table, table.reference) if number == len(chosen[:_MOST_LINES]) - 1 else None
            axis.plot(at, beside, "--", color=colour, linewidth=1, label=told)
    axis.set_xscale(table.x_scale)
    axis.set_yscale(table.value_scale)
    _plain_ticks(axis, table)
    if table.good_below is not None:
        axis.axhline(table.good_below, color="C3", linewidth=0.8)
    axis.set_xlabel(_label(table, x_key))
    axis.set_ylabel(_label(table, table.value))
    axis.grid(alpha=0.3, which="both")


def _legend_beside(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend of all panels' lines, where it covers none of them."""
    named: dict[str, Any] = {}
    for axis in axes:
        handles, names = axis.get_legend_handles_labels()
        named |= {name: handle for handle, name in zip(handles, names, strict=True) if name not in named}
    if named:
        figure.legend(list(named.values()), list(named), loc="outside right upper", fontsize=8)


def _spread(rows: Sequence[Row], x: str, value: str) -> tuple[Float, Float, Float, Float]:
    """x, rising, and low, middle and high of the value there; what failed is left out."""
    places = _numbers(rows, x)
    values = _numbers(rows, value)
    known = np.isfinite(places) & np.isfinite(values)
    found = sorted(set(places[known]))
    parts = [
        np.percentile(values[known & (places == place)], (_LOW_PERCENT, 50, _HIGH_PERCENT)) for place in found
    ]
    low, middle, high = np.array(parts).reshape(-1, 3).T
    return np.array(found), low, middle, high


def _bars(axis: Axes, table: FigureTable, rows: Sequence[Row], every: Sequence[Row]) -> None:
    """Groups of bars, their medians written on top."""
    x_key = str(table.x)
    xs = _values(every, x_key)
    chosen = _values(every, table.lines) if table.lines else [None]
    width = 0.8 / len(chosen)
    for number, line in enumerate(chosen):
        on_line = [row for row in rows if line is None or row[str(table.lines)] == line]
        heights = [_median([row for row in on_line if row[x_key] == x], table.value) for x in xs]
        at = np.arange(len(xs)) - 0.4 + (number + 0.5) * width
        name = None if line is None else _said(table, str(table.lines), line)
        bars = axis.bar(at, np.nan_to_num(heights), 0.92 * width, color=f"C{number}", label=name)
        axis.bar_label(bars, [f"{value:.2g}" if np.isfinite(value) else "-" for value in heights], fontsize=7)
    axis.set_xticks(range(len(xs)), [_short(x) for x in xs], **_slanted(xs))
    axis.set_yscale(table.value_scale)
    axis.set_xlabel(_label(table, x_key))
    axis.set_ylabel(_label(table, table.value))
    axis.grid(alpha=0.3, axis="y")
    if table.lines:
        axis.legend(fontsize=8, title=_label(table, table.lines))


def _histogram(axis: Axes, table: FigureTable, rows: Sequence[Row], every: Sequence[Row]) -> None:
    """How the runs' values are spread; all outlines share their bins."""
    known = _numbers(every, table.value)
    known = known[np.isfinite(known)]
    if not known.size:
        axis.text(0.5, 0.5, "nothing to tell", ha="center", transform=axis.transAxes)
        return
    if table.value_scale == "log" and (known > 0).all() and np.ptp(known) > 0:
        bins = np.geomspace(known.min(), known.max(), 25)
        axis.set_xscale("log")
    else:
        bins = np.histogram_bin_edges(known, bins="auto" if np.ptp(known) > 0 else 1)
    chosen = _values(every, table.lines) if table.lines else [None]
    for number, line in enumerate(chosen):
        values = _numbers([r for r in rows if line is None or r[str(table.lines)] == line], table.value)
        values = values[np.isfinite(values)]
        name = "" if line is None else f"{_said(table, str(table.lines), line)}: "
        if values.size:
            low, middle, high = np.percentile(values, (_LOW_PERCENT, 50, _HIGH_PERCENT))
            name += f"median {middle:.3g}, 16 to 84 %: {low:.3g} to {high:.3g}"
        axis.hist(values, bins=bins.tolist(), color=f"C{number}", alpha=0.5, label=name)
    axis.set_xlabel(_label(table, table.value))
    axis.set_ylabel("runs")
    axis.legend(fontsize=8)


_KINDS: dict[str, Callable[[Axes, FigureTable, Sequence[Row], Sequence[Row]], Any]] = {
    "map": _map,
    "curves": _curves,
    "bars": _bars,
    "histogram": _histogram,
}


def _values(rows: Sequence[Row], column: str | None) -> list[Any]:
    """Values of a column: numbers rising, words in the order in which they come."""
    found = list(dict.fromkeys(row[str(column)] for row in rows if row[str(column)] is not None))
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in found)
    return sorted(found) if numbers else found


def _numbers(rows: Sequence[Row], column: str) -> Float:
    values = (row[column] for row in rows)
    return np.array(
        [float(value) if isinstance(value, int | float) else np.nan for value in values], dtype=np.float64
    )


def _median(rows: Sequence[Row], column: str) -> float:
    values = _numbers(rows, column)
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _label(table: FigureTable, column: str) -> str:
    return table.labels.get(column, column)


def _said(table: FigureTable, column: str, value: Any) -> str:
    """A value with its name; words speak for themselves, as does a value that has a label of its own."""
    own = table.labels.get(f"{column}={_short(value)}")
    if own is not None:
        return own
    return value if isinstance(value, str) else f"{_label(table, column)} {_short(value)}"


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _slanted(values: Sequence[Any]) -> dict[str, Any]:
    """How to write the names below an axis: long ones aslant."""
    if max(len(_short(value)) for value in values) * len(values) <= 60:
        return {}
    return {"rotation": 30, "ha": "right"}


def _plain_ticks(axis: Axes, table: FigureTable) -> None:
    """Numbers, not powers of ten, on logarithmic axes."""
    for scale, one in ((table.x_scale, axis.xaxis), (table.value_scale, axis.yaxis)):
        if scale == "log":
            plain_log_ticks(one)


def _note(table: FigureTable, rows: Sequence[Row]) -> str:
    """What stands below the picture."""
    failed = sum(row["failure"] is not None for row in rows)
    said = [table.caption] if table.caption else []
    if table.kind == "map" and table.reference is not None:
        said.append(f"dashed: {_label(table, table.reference)}")
    runs = f"{len(rows)} runs" + (f", {failed} of them failed" if failed else "")
    return "\n".join(filter(None, ("; ".join(said), runs)))
