"""The picture of one surface: maps of depth, slope and sigma over the mirror."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from zeromethod.surface import Surface, check_surface, peak
from zeromethod.view.axes import save
from zeromethod.view.figure import draw_map
from zeromethod.view.table import cell


def plot(surface: Surface, path: str | Path | None = None) -> Figure:
    """Plot depth, both slopes and the depth's sigma of a surface over the mirror in mm.

    Parameters
    ----------
    surface : Surface
        What was read, as `Step.surface`, `SurfaceReader.read` or `Recording.surface` give it.
    path : str or Path, optional
        Also save the picture there; the suffix (.png, .svg, .pdf) chooses the format.

    Returns
    -------
    matplotlib.figure.Figure
        Four maps of the valid nodes, depth positive into the rubber.
    """
    check_surface("plot", surface)
    with mpl.rc_context({"font.size": 8, "axes.titlesize": 9}):
        figure = Figure(figsize=(10, 6), layout="constrained")
        axes = figure.subplots(2, 2)
        draw_map(axes[0, 0], surface, surface.depth_mm, "depth (into the rubber = positive)", "mm")
        sigma_nm = 1e6 * surface.sigma_depth_mm
        draw_map(axes[0, 1], surface, sigma_nm, "depth sigma", "nm", signed=False)
        draw_map(axes[1, 0], surface, 1e3 * surface.slope[..., 0], "slope dd/dx", "mrad")
        draw_map(axes[1, 1], surface, 1e3 * surface.slope[..., 1], "slope dd/dy", "mrad")
        if surface.valid.any():
            deepest = peak(surface)
            axes[0, 0].plot(deepest.x_mm, deepest.y_mm, "k+")
            words = f"peak {deepest.depth_mm:.5f} mm, sigma {cell(1e6 * deepest.sigma_mm, '{:.0f}')} nm"
        else:
            words = "no node could be read"
        figure.suptitle(f"{words}, at {1e-9 * surface.time_ns:.3f} s")
        if path is not None:
            save(figure, path)
    return figure
