"""A replayed session next to the recorded one, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from zeromethod.arrays import Float
from zeromethod.view.axes import labelled, picture

_COLOURS = ("C7", "C0", "C3")
_WIDTHS = (3.0, 1.5, 1.0)
"""Curves that coincide are drawn the wider the earlier, so that each is visible."""


def draw_sessions(curves: dict[str, dict[str, Float]], title: str, path: Path) -> None:
    """Write sessions as PNG: peak depth, residual, depth error over time, motion left over frequency.

    curves: by session's name; each time_s, depth_peak_mm, residual_rms_px, depth_error_um, frequency_hz and
    left, NaN where not known.
    """
    with picture(path, (12, 7.5), title) as figure:
        axes = figure.subplots(2, 2)
        panels = (
            ("time_s", "depth_peak_mm", "largest depth read", "mm", "linear"),
            ("time_s", "residual_rms_px", "residual", "camera px rms", "log"),
            ("time_s", "depth_error_um", "depth error against the simulated mirror", "µm rms", "log"),
            ("frequency_hz", "left", "motion of the mirror that is left in the picture", "share", "log"),
        )
        for axis, (x, y, heading, unit, scale) in zip(axes.flat, panels, strict=True):
            for number, (name, curve) in enumerate(curves.items()):
                _plot(axis, curve[x], curve[y], name, number, marker="." if y == "left" else "")
            if y == "left":
                axis.axhline(1.0, color="k", linewidth=0.8, linestyle=":")
            _finish(axis, heading, "Hz" if y == "left" else "s", unit, scale)
        axes[1, 1].set_xscale("log")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_differences(figures: dict[str, Any], title: str, path: Path) -> None:
    """Write readings as PNG: peak depth recorded and replayed over time, and how far depth differs.

    figures: as `zeromethod.session.replay.differences.DepthDifferences.figures` gives them.
    """
    peaks = {key: np.array(values, dtype=np.float64) for key, values in figures["peaks"].items()}
    rms_nm = np.array(figures["depth_difference_rms_nm"], dtype=np.float64)
    with picture(path, (10, 6), title) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        _plot(above, peaks["time_s"], peaks["recorded_mm"], "recorded", 0)
        _plot(above, peaks["time_s"], peaks["replayed_mm"], "replayed", 1)
        _finish(above, "largest depth read", "s", "mm", "linear")
        _plot(below, peaks["time_s"], 1e6 * (peaks["replayed_mm"] - peaks["recorded_mm"]), "peak", 2)
        _plot(below, peaks["time_s"], rms_nm, "all nodes, rms", 1)
        _finish(below, "replayed less recorded", "s", "nm", "linear")
        above.legend()
        below.legend()


def _plot(axis: Axes, x: Float, y: Float, name: str, number: int, marker: str = "") -> None:
    number %= len(_COLOURS)
    axis.plot(x, y, label=name, color=_COLOURS[number], linewidth=_WIDTHS[number], marker=marker)


def _finish(axis: Axes, heading: str, unit_x: str, unit_y: str, scale: str) -> None:
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in axis.get_lines()])
    # nothing positive cannot be drawn to a logarithmic scale
    axis.set_yscale(scale if np.any(drawn > 0) else "linear")
    labelled(axis, heading, unit_x, unit_y)
    axis.grid(alpha=0.3)
