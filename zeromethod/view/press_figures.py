"""Figures 13 to 15 of the paper, as the simulated bench gives them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.paper.lattice_reading import LatticeReading
from zeromethod.paper.series import Series

_FONT: Any = {"font.size": 9, "axes.titlesize": 10}


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
    with mpl.rc_context(_FONT):
        figure = Figure(figsize=(columns / 62, rows / 62 + 0.7), layout="constrained")
        axis = figure.subplots()
        shown: Any = image
        axis.imshow(shown, cmap="gray", vmin=0, vmax=white)
        axis.plot(picks[:, 0], picks[:, 1], "o", color="yellow", markersize=6, markeredgecolor="black")
        axis.set_title(f"{title} (yellow: the {len(picks)} crossings that are used)")
        axis.set_xlabel("u, camera px (away from P0)")
        axis.set_ylabel("v, camera px")
        figure.savefig(path, dpi=110)


def _draw_depth(series: Series, truth: tuple[Float, Float], path: Path) -> None:
    with mpl.rc_context(_FONT):
        figure = Figure(figsize=(8, 5), layout="constrained")
        axis = figure.subplots()
        axis.plot(*truth, color="black", linewidth=1, label="truth")
        axis.plot(series.l_rises, series.depth_rises, "-", marker="_", color="C0", label="rises, from 0")
        axis.plot(series.l_drops, series.depth_drops, "--", marker="^", color="C1", label="drops, from L0")
        axis.plot(series.l, series.depth, "o", color="C3", markerfacecolor="none", label="average")
        axis.invert_yaxis()
        axis.set_title("Figure 15: depth along the line, whole-pixel picks, equations 17 and 19")
        axis.set_xlabel("l, mm from P0 along the mirror")
        axis.set_ylabel("d, mm (into the rubber = down)")
        axis.legend()
        axis.grid(alpha=0.3)
        figure.savefig(path, dpi=110)
