"""Why close the loop, as a picture and a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from rich.table import Table

from zeromethod.arrays import Float
from zeromethod.view.axes import picture

LABELS = {
    "none": "everything right",
    "sensor": "sensor reads 2 % too much",
    "display": "display response 2 % off",
    "distortion": "lens distortion 2 %",
}
METHOD_LABELS = {"open": "open loop", "null": "null"}
ZERO_LABELS = {
    "rays": "rays from the measured rest",
    "difference": "difference from the measured rest",
    "rig": "rest as the rig file says",
}
FEW_READ = 0.98
"""Share of the usable nodes below which a reading is marked in the table."""

_COLOURS = {"none": "C7", "sensor": "C3", "display": "C2", "distortion": "C0"}
_ZERO_COLOURS = {"rays": "C0", "difference": "C1", "rig": "C4"}
_WIDTHS = {"none": 5.0, "display": 3.0, "distortion": 1.5, "sensor": 1.5}
"""Curves that coincide are drawn the wider the earlier, so that each is visible."""
_STYLES: dict[str, dict[str, Any]] = {
    "open": {"linestyle": "-", "marker": "o", "markersize": 4.0},
    "null": {"linestyle": "--", "marker": "s", "markersize": 4.0, "markerfacecolor": "none"},
}


def open_loop_table(figures: dict[str, Any]) -> Table:
    """Error of the peak in per cent over the depth error in nm rms, per error, way of reading and depth.

    figures: as `benchmarks.against_peers.open_loop.compare_open_loop` gives them.
    """
    floors = ", ".join(f"{METHOD_LABELS[m]} {nm:.0f} nm rms" for m, nm in figures["noise_floor_nm"].items())
    table = Table(
        title=f"Press of sigma {figures['press']['sigma_mm']:g} mm: error of the peak, depth error rms",
        caption=f"untouched, one reading: {floors}; * fewer than {FEW_READ:.0%} of the usable nodes read",
        show_lines=False,
    )
    table.add_column("what is wrong")
    table.add_column("read by")
    for row in figures["errors"]["none"]["open"]:
        table.add_column(f"{1e3 * row['depth_mm']:g} um", justify="right")
    for kind, by_method in figures["errors"].items():
        _add(table, LABELS[kind], by_method)
    for zero, by_method in figures["distortion_zeros"].items():
        if zero != "rays":
            _add(table, f"{LABELS['distortion']}\n{ZERO_LABELS[zero]}", by_method)
    return table


def _add(table: Table, label: str, by_method: dict[str, list[dict[str, Any]]]) -> None:
    for number, (method, rows) in enumerate(by_method.items()):
        table.add_row("" if number else label, METHOD_LABELS[method], *(_cell(row) for row in rows))
    table.add_section()


def _cell(row: dict[str, Any]) -> str:
    if not row["frames"]:
        return "not\nnulled"
    few = "*" if row["valid_share"] < FEW_READ else ""
    percent = row["peak_error_percent"]
    peak = f"{percent:+.2f} %" if abs(percent) < 100 else f"{percent:+.0f} %"
    return f"{peak}{few}\n{row['rms_error_nm']:.0f} nm"


def draw_open_loop(figures: dict[str, Any], path: Path) -> None:
    """Write the comparison as PNG: peak error, what each planted error changes, depth error, the zeros.

    figures: as `benchmarks.against_peers.open_loop.compare_open_loop` gives them.
    """
    errors, zeros, floor = figures["errors"], figures["distortion_zeros"], figures["noise_floor_nm"]
    right = errors["none"]
    with picture(path, (12, 8.6), _title(figures)) as figure:
        axes = figure.subplots(2, 2)
        for kind, by_method in errors.items():
            for method, rows in by_method.items():
                style = {**_STYLES[method], "color": _COLOURS[kind], "linewidth": _WIDTHS[kind]}
                label = f"{METHOD_LABELS[method]}, {LABELS[kind]}"
                depth_um, peak = _column(rows, "peak_error_percent")
                axes[0, 0].plot(depth_um, np.abs(peak), label=label, **style)
                if kind != "none":
                    change = peak - _column(right[method], "peak_error_percent")[1]
                    axes[0, 1].plot(depth_um, change, label=label, **style)
                axes[1, 0].plot(*_column(rows, "rms_error_nm"), label=label, **style)
        for zero, by_method in zeros.items():
            for method, rows in by_method.items():
                style = {**_STYLES[method], "color": _ZERO_COLOURS[zero]}
                label = f"{METHOD_LABELS[method]}, {ZERO_LABELS[zero]}"
                axes[1, 1].plot(*_column(rows, "rms_error_nm"), label=label, **style)
        depth_mm = np.array([row["depth_mm"] for row in right["open"]])
        for method, nm in floor.items():
            noise = {"color": "k", "linewidth": 0.8, "linestyle": ":" if method == "null" else "-."}
            noise_label = f"noise of one reading, {METHOD_LABELS[method]}"
            percent = 1e-4 * nm / depth_mm
            axes[0, 0].plot(1e3 * depth_mm, percent, label=noise_label, **noise)
            axes[0, 1].plot(1e3 * depth_mm, percent, label=noise_label, **noise)
            axes[0, 1].plot(1e3 * depth_mm, -percent, **noise)
            for axis in axes[1]:
                axis.axhline(nm, label=noise_label, **noise)
        _finish(axes[0, 0], "error of the peak", "|error|, % of the press", "log")
        axes[0, 0].set_ylim(bottom=1e-3)
        _finish(axes[0, 1], "what the planted error changes in it", "change, % of the press", "linear")
        axes[0, 1].set_ylim(-2, 4)
        _finish(axes[1, 0], "depth error over the view", "nm rms", "log")
        _finish(axes[1, 1], "lens distortion unknown: three zeros", "nm rms", "log")
        axes[1, 1].legend(fontsize=7)
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)


def _column(rows: list[dict[str, Any]], key: str) -> tuple[Float, Float]:
    """(depth in um, values), NaN where there was nothing to read."""
    values = [np.nan if row[key] is None else row[key] for row in rows]
    return 1e3 * np.array([row["depth_mm"] for row in rows]), np.array(values, dtype=np.float64)


def _finish(axis: Axes, title: str, unit: str, scale: str) -> None:
    axis.set_title(title)
    axis.set_xscale("log")
    axis.set_yscale(scale)
    axis.set_xlabel("depth of the press, um")
    axis.set_ylabel(unit)
    axis.grid(alpha=0.3)


def _title(figures: dict[str, Any]) -> str:
    pixels = "" if figures["binning"] == 1 else f", pixels {figures['binning']} times larger"
    sigma = figures["press"]["sigma_mm"]
    return f"zeromethod  open loop against null, rig {figures['rig']}{pixels}, press of sigma {sigma:g} mm"
