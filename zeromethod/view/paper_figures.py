"""Figures 5 to 9 and 13 to 15 of the paper, drawn from its reproduction."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.paper.lattice_reading import LatticeReading
from zeromethod.paper.needle import PAPER_DEPTH_ERROR_PX, PAPER_THETA_ERROR_RAD
from zeromethod.paper.needle_reading import NeedleResult
from zeromethod.paper.series import Series
from zeromethod.view.axes import labelled, picture

_MARKS = 48
"""Marks per curve: every point would hide the others."""


def draw_needle_figures(result: NeedleResult, folder: Path) -> list[Path]:
    """Write figure-05.png to figure-09.png into an existing folder and return their paths.

    6 to 9 show the first column (equation 17 on the gamma = 0 model) with the paper's marks; 8 and 9 also the
    own reading of the same surface (dashed), one averaging window away from the tip.
    """
    points, series, needle, own = result.printed.l, result.printed.series, result.needle, result.zero_method
    theta, depth = needle.theta(points), needle.depth(points)
    thetas = series.theta_rises, series.theta_drops, series.theta
    depths = series.depth_rises, series.depth_drops, series.depth
    paths = [folder / f"figure-{number:02d}.png" for number in range(5, 10)]
    with _needle_axis(paths[0], "Figure 5: needle-shaped surface", "d, px (into the rubber = down)") as axis:
        _surface(axis, result)
    for path, title, y, truth, parts in (
        (paths[1], "Figure 6: slope angle", "theta, rad", theta, thetas),
        (paths[2], "Figure 7: depth", "d, px", depth, depths),
    ):
        with _needle_axis(path, title, y) as axis:
            axis.plot(points, truth, "k", linewidth=1, label="truth")
            _series(axis, points, parts)
            axis.legend(loc="best", fontsize=8)
    away = np.abs(own.l - needle.tip_px) > own.window_px
    for path, name, unit, bound, truth, parts, error in (
        (paths[3], "theta", "rad", PAPER_THETA_ERROR_RAD, theta, thetas, own.theta - needle.theta(own.l)),
        (paths[4], "d", "px", PAPER_DEPTH_ERROR_PX, depth, depths, own.depth - needle.depth(own.l)),
    ):
        words = "depth" if name == "d" else name
        title = f"Figure {path.stem[-1]}: error of {words}"
        with _needle_axis(path, title, f"error of {name}, {unit}") as axis:
            _series(axis, points, tuple(part - truth for part in parts))
            dashed = np.where(away, own.l, np.nan), np.where(away, error, np.nan)
            axis.plot(*dashed, "k--", linewidth=1, label="zero method")
            for sign, label in ((1, f"the paper's bound, {bound:g} {unit}"), (-1, None)):
                axis.axhline(sign * bound, color="0.5", linestyle=":", label=label)
            axis.legend(loc="best", fontsize=8)
    return paths


@contextmanager
def _needle_axis(path: Path, title: str, y: str) -> Iterator[Axes]:
    with picture(path, (8, 4.5), font=9) as figure:
        axis = figure.subplots()
        axis.grid(alpha=0.3)
        yield axis
        labelled(axis, title, "l, px from P0", y)


def _surface(axis: Axes, result: NeedleResult) -> None:
    needle = result.needle
    l = np.linspace(0.0, needle.length_px, 2001)  # noqa: E741
    axis.plot(l, needle.depth(l), "k")
    axis.fill_between(l, needle.depth(l), 1.6 * needle.peak_px, color="0.9")
    axis.text(needle.tip_px, 1.4 * needle.peak_px, "rubber", ha="center")
    axis.set_ylim(1.6 * needle.peak_px, -0.2 * needle.peak_px)


def _series(axis: Axes, points: Float, series: tuple[Float, ...]) -> None:
    every = max(1, len(points) // _MARKS)
    styles = (("_", "C0", "rises from l = 0"), ("^", "C1", "drops from l = L0"), ("o", "C2", "average"))
    for shift, (values, (mark, colour, name)) in enumerate(zip(series, styles, strict=True)):
        # every curve starts its marks a third of the way on, so that equal values do not cover each other
        some = slice(shift * every // 3, None, every)
        axis.plot(
            points[some], values[some], mark, color=colour, label=name, markersize=5, markerfacecolor="none"
        )


def draw_press_figures(
    before: NDArray[np.generic],
    after: NDArray[np.generic],
    reading: LatticeReading,
    truth: tuple[Float, Float],
    folder: Path,
) -> list[Path]:
    """Write figure-13.png to figure-15.png into an existing folder; truth: (l, depth), mm along the line."""
    line = reading.line
    paths = [folder / f"figure-{number}.png" for number in (13, 14, 15)]
    white = float(max(before.max(), after.max()))
    _draw_image(before, line.before, white, "Figure 13: before the press", paths[0])
    _draw_image(after, line.after, white, "Figure 14: pressed 0.2 mm", paths[1])
    _draw_depth(reading.series, truth, paths[2])
    return paths


def _draw_image(image: NDArray[np.generic], picks: Float, white: float, title: str, path: Path) -> None:
    """Camera image with the picked crossings in yellow, pixel for pixel or larger."""
    rows, columns = image.shape
    with picture(path, (columns / 62, rows / 62 + 0.7), font=9) as figure:
        axis = figure.subplots()
        shown: Any = image
        axis.imshow(shown, cmap="gray", vmin=0, vmax=white)
        axis.plot(picks[:, 0], picks[:, 1], "o", color="yellow", markersize=6, markeredgecolor="black")
        words = f"{title} (yellow: the {len(picks)} crossings that are used)"
        labelled(axis, words, "u, camera px (away from P0)", "v, camera px")


def _draw_depth(series: Series, truth: tuple[Float, Float], path: Path) -> None:
    with picture(path, (8, 5), font=9) as figure:
        axis = figure.subplots()
        axis.plot(*truth, color="black", linewidth=1, label="truth")
        axis.plot(series.l_rises, series.depth_rises, "-", marker="_", color="C0", label="rises, from 0")
        axis.plot(series.l_drops, series.depth_drops, "--", marker="^", color="C1", label="drops, from L0")
        axis.plot(series.l, series.depth, "o", color="C3", markerfacecolor="none", label="average")
        axis.invert_yaxis()
        title = "Figure 15: depth along the line, whole-pixel picks, equations 17 and 19"
        labelled(axis, title, "l, mm from P0 along the mirror", "d, mm (into the rubber = down)")
        axis.legend()
        axis.grid(alpha=0.3)
