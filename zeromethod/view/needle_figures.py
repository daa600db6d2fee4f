"""Figures 5 to 9 of the paper, drawn from the reproduction of its section 3.1."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zeromethod.arrays import Float
from zeromethod.paper.needle import PAPER_DEPTH_ERROR_PX, PAPER_THETA_ERROR_RAD
from zeromethod.paper.needle_reading import NeedleResult

_MARKS = 48
"""Marks per curve: every point would hide the others."""


def draw_needle_figures(result: NeedleResult, folder: Path) -> list[Path]:
    """Write figure-05.png to figure-09.png into an existing folder and return their paths.

    6 to 9 show the first column (equation 17 on the gamma = 0 model) with the paper's marks; 8 and 9 also the
    own reading of the same surface (dashed), one averaging window away from the tip.
    """
    points, series, needle = result.printed.l, result.printed.series, result.needle
    theta, depth = needle.theta(points), needle.depth(points)
    own = result.zero_method
    theta_series = series.theta_rises, series.theta_drops, series.theta
    depth_series = series.depth_rises, series.depth_drops, series.depth
    drawings = {
        5: "needle-shaped surface",
        6: "slope angle",
        7: "depth",
        8: "error of theta",
        9: "error of depth",
    }
    paths = []
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        for number, title in drawings.items():
            figure = Figure(figsize=(8, 4.5), layout="constrained")
            axis = figure.subplots()
            if number == 5:
                _surface(axis, result)
            elif number == 6:
                axis.plot(points, theta, "k", linewidth=1, label="truth")
                _series(axis, points, theta_series)
                axis.set_ylabel("theta, rad")
            elif number == 7:
                axis.plot(points, depth, "k", linewidth=1, label="truth")
                _series(axis, points, depth_series)
                axis.set_ylabel("d, px")
            elif number == 8:
                _series(axis, points, tuple(part - theta for part in theta_series))
                _own(axis, result, own.theta - needle.theta(own.l))
                _bound(axis, PAPER_THETA_ERROR_RAD, "rad")
                axis.set_ylabel("error of theta, rad")
            else:
                _series(axis, points, tuple(part - depth for part in depth_series))
                _own(axis, result, own.depth - needle.depth(own.l))
                _bound(axis, PAPER_DEPTH_ERROR_PX, "px")
                axis.set_ylabel("error of d, px")
            axis.set_title(f"Figure {number}: {title}")
            axis.set_xlabel("l, px from P0")
            if number != 5:
                axis.legend(loc="best", fontsize=8)
            path = folder / f"figure-{number:02d}.png"
            figure.savefig(path, dpi=110)
            paths.append(path)
    return paths


def _surface(axis: Axes, result: NeedleResult) -> None:
    needle = result.needle
    l = np.linspace(0.0, needle.length_px, 2001)  # noqa: E741
    axis.plot(l, needle.depth(l), "k")
    axis.fill_between(l, needle.depth(l), 1.6 * needle.peak_px, color="0.9")
    axis.text(needle.tip_px, 1.4 * needle.peak_px, "rubber", ha="center")
    axis.set_ylim(1.6 * needle.peak_px, -0.2 * needle.peak_px)
    axis.set_ylabel("d, px (into the rubber = down)")


def _series(axis: Axes, points: Float, series: tuple[Float, ...]) -> None:
    every = max(1, len(points) // _MARKS)
    styles = (("_", "C0", "rises from l = 0"), ("^", "C1", "drops from l = L0"), ("o", "C2", "average"))
    for shift, (values, (mark, colour, name)) in enumerate(zip(series, styles, strict=True)):
        # every curve starts its marks a third of the way on, so that equal values do not cover each other
        some = slice(shift * every // 3, None, every)
        axis.plot(
            points[some], values[some], mark, color=colour, label=name, markersize=5, markerfacecolor="none"
        )


def _own(axis: Axes, result: NeedleResult, error: Float) -> None:
    own = result.zero_method
    away = np.abs(own.l - result.needle.tip_px) > own.window_px
    axis.plot(
        np.where(away, own.l, np.nan), np.where(away, error, np.nan), "k--", linewidth=1, label="zero method"
    )


def _bound(axis: Axes, bound: float, unit: str) -> None:
    for sign, label in ((1, f"the paper's bound, {bound:g} {unit}"), (-1, None)):
        axis.axhline(sign * bound, color="0.5", linestyle=":", label=label)
