"""What pictures share: a page that is written as PNG, labels, colours, ticks of logarithmic axes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from zeromethod.arrays import Float
from zeromethod.atomic_write import atomic_write
from zeromethod.fine.surface import FineSurface
from zeromethod.surface import Surface
from zeromethod.warp.grid import INNER

_FEW_DECADES = 3.0
_PICTURE_COLS = 300
"""Columns of pixels that a map shows, up to twice as many."""


@contextmanager
def picture(
    path: str | Path | None, inches: tuple[float, float], title: str = "", font: int = 8
) -> Iterator[Figure]:
    """A figure under a title, which is written at the end where there is a path."""
    with mpl.rc_context({"font.size": font, "axes.titlesize": font + 1}):
        figure = Figure(figsize=inches, layout="constrained")
        yield figure
        if title:
            figure.suptitle(title, fontsize=11)
        if path is not None:
            save(figure, path)


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure in one move, in the format of its suffix."""
    path = Path(path)
    with atomic_write(path) as part:
        figure.savefig(part, dpi=110, format=path.suffix[1:] or None)


def labelled(axis: Axes, title: str, x: str, y: str) -> None:
    """Title and axis labels."""
    axis.set_title(title)
    axis.set_xlabel(x)
    axis.set_ylabel(y)


def centred(axis: Axes, words: str) -> None:
    """Words in place of what is missing."""
    axis.text(0.5, 0.5, words, ha="center", va="center", transform=axis.transAxes)


def colours(values: Float, percentile: float, *, signed: bool) -> dict[str, Any]:
    """Colour map and its ends: symmetric round zero, or from zero up, to a percentile of |values|."""
    finite = np.abs(values[np.isfinite(values)])
    high = (float(np.percentile(finite, percentile)) if finite.size else 0.0) or 1.0
    return {"cmap": "RdBu_r" if signed else "viridis", "vmin": -high if signed else 0.0, "vmax": high}


def colour_bar(axis: Axes, shown: Any, unit: str, **more: Any) -> None:
    """Scale of what is shown in colours, pointed where values lie beyond its end."""
    assert axis.figure is not None
    values = np.ma.masked_invalid(shown.get_array()).compressed()
    low, high = (values < shown.norm.vmin).any(), (values > shown.norm.vmax).any()
    ends = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
    look: dict[str, Any] = {"shrink": 0.8, "extend": ends[bool(low), bool(high)]} | more
    axis.figure.colorbar(shown, ax=axis, label=unit, **look)


def over_mirror(axis: Axes, surface: Surface, values: Float, **look: Any) -> QuadMesh:
    """Values (rows, cols) as cells at their nodes' places on the mirror, mm; NaN and padding are left out."""
    axis.set_aspect("equal")
    with warnings.catch_warnings():
        # cells that are not drawn may lie across their neighbours
        warnings.filterwarnings("ignore", message="The input coordinates to pcolormesh")
        x_mm, y_mm = surface.x_mm[INNER], surface.y_mm[INNER]
        return axis.pcolormesh(x_mm, y_mm, values[INNER], shading="nearest", **look)


def pixels_over_mirror(axis: Axes, surface: FineSurface, values: Float, **look: Any) -> QuadMesh:
    """Values (rows, cols) of a fine surface at their pixels' places on the mirror, mm.

    Every so many-th pixel where there are more than a picture shows.
    """
    thin = (slice(None, None, max(1, surface.depth_mm.shape[1] // _PICTURE_COLS)),) * 2
    axis.set_aspect("equal")
    return axis.pcolormesh(
        surface.x_mm[thin], surface.y_mm[thin], values[thin], shading="nearest", rasterized=True, **look
    )


def plain_log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis by numbers such as 0.05; call it when all is drawn.

    Below a decade the ticks are round numbers at equal distances, of which there are always some; up to a
    few decades 1, 2 and 5 of each; beyond, the decades.
    """
    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low) if low > 0.0 else math.inf
    if decades < 1.0:
        axis.set_major_locator(MaxNLocator(5))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < _FEW_DECADES else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axis.set_minor_formatter(NullFormatter())
