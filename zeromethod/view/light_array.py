"""Table and picture of a run of LED and detector arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from rich.table import Table

from zeromethod.arrays import Float
from zeromethod.light_array.devices import FULL_SCALE, Counts
from zeromethod.light_array.rig import SIDE
from zeromethod.light_array.session import LightSession
from zeromethod.view.axes import centred, colour_bar, colours, labelled, picture
from zeromethod.view.table import event_rows, figure_rows, pair_table

_ROWS = (
    ("state at the end", ("state",), "{}"),
    ("frames (lost)", ("frames", "dropped"), "{} ({})"),
    ("readings of depth, each of five frames", ("readings_of_depth",), "{}"),
    ("residual at the end, of full scale", ("light_residual",), "{:.5f}"),
    ("residual while pressed", ("light_residual_pressed",), "{:.5f}"),
    ("peak depth at the end (sigma)", ("depth_peak_mm", "depth_peak_sigma_mm"), "{:.5f} mm ({:#.2g})"),
    (
        "deepest reading (sigma), where",
        ("deepest.depth_mm", "deepest.sigma_mm", "deepest.x_mm", "deepest.y_mm"),
        "{:.5f} mm ({:#.2g}) at {:.1f}, {:.1f} mm",
    ),
    ("peak error, worst of hold and slide", ("truth.depth_peak_error_percent",), "{:+.3f} %"),
    ("the same in its sigmas", ("truth.depth_peak_error_sigmas",), "{:+.2f}"),
    ("depth error in hold and slide", ("truth.depth_rms_error_um",), "{:.3f} µm rms"),
    ("depth noise untouched, 1 kHz", ("untouched_rms_um",), "{:.3f} µm rms"),
    ("computing, readings in to levels out", ("loop_ms.median", "loop_ms.p99"), "{:.3f} ms (p99 {:.3f})"),
)


_GAP_S = 0.01
"""Longest time between two readings that a line goes across."""


def light_table(figures: dict[str, Any]) -> Table:
    """Table of the figures that there are."""
    left_out = [("left out", f"{name}: {why}") for name, why in figures["faults"].items()]
    return pair_table([*figure_rows(figures, _ROWS), *left_out, *event_rows(figures)])


def plot_light_run(session: LightSession, path: Path) -> None:
    """Levels at rest and where the press was deepest, depth there, a section, and the peak over time."""
    with picture(path, (12, 7), f"zeromethod  rig {session.rig.name}: zero method in light levels") as figure:
        axes, start, step = figure.subplots(2, 3), session.loop.start, session.pressed
        rest = None if start is None else _light(start.levels)
        grey = {"cmap": "gray", "vmin": 0, "vmax": 1}
        _plot_array(axes[0, 0], rest, "LED levels at rest", grey)
        if rest is None or step is None or step.shown is None or step.modes is None:
            for axis in axes.flat[1:]:
                centred(axis, "nothing was read")
            return
        nulled = _light(step.shown)
        _plot_array(axes[0, 1], nulled, "LED levels, nulled", grey)
        change = nulled - rest
        words = "change of the levels: what is measured"
        _plot_array(axes[0, 2], change, words, colours(change, 100, signed=True))
        x, y, depth = session.loop.reader.depth_map(step.modes)
        depth_um = 1e3 * depth
        shown = axes[1, 0].pcolormesh(
            x, y, depth_um, shading="nearest", **colours(depth_um, 100, signed=True)
        )
        axes[1, 0].set_aspect("equal")
        labelled(axes[1, 0], f"depth at {step.time_s:.3f} s", "x, mm", "y, mm")
        colour_bar(axes[1, 0], shown, "µm")
        row = int(np.unravel_index(np.argmax(np.abs(depth)), depth.shape)[0])
        axes[1, 1].plot(x, depth_um[row], label="read")
        if (true := session.true_depth(step, x, np.full(x.shape, y[row]))) is not None:
            axes[1, 1].plot(x, 1e3 * true, "--", label="true")
            axes[1, 1].legend()
        axes[1, 1].invert_yaxis()
        labelled(axes[1, 1], f"section at y = {y[row]:.1f} mm (into the rubber = down)", "x, mm", "depth, µm")
        history = np.array(session.history)
        gaps = 1 + np.flatnonzero(np.diff(history[:, 0]) > _GAP_S)
        time_s, peak, sigma = np.insert(history, gaps, np.nan, axis=0).T
        axes[1, 2].plot(time_s, 1e3 * peak)
        axes[1, 2].fill_between(time_s, 1e3 * (peak - 2 * sigma), 1e3 * (peak + 2 * sigma), alpha=0.3)
        labelled(axes[1, 2], "peak, and two sigma", "s", "µm")


def _light(levels: Counts) -> Float:
    """(16, 16) levels, of full light."""
    return levels.reshape(SIDE, SIDE) / FULL_SCALE


def _plot_array(axis: Axes, values: Float | None, title: str, look: dict[str, Any]) -> None:
    """One value per LED in colours; nothing for None."""
    labelled(axis, title, "LED along the face", "LED along y")
    if values is not None:
        colour_bar(axis, axis.imshow(values, origin="lower", **look), "of full light")
