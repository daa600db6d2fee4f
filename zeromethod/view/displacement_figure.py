"""The picture of one measured still image: displacement, sigma and, with a rig, depth, over the reference."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zeromethod.arrays import Float, Image
from zeromethod.passive.measure import StillReading

_ALPHA = 0.7
_DEPTH_UNIT_UM = 1e3


def draw_displacement(reading: StillReading, reference: Image, path: Path) -> None:
    """Write the picture of a reading as PNG. What is not valid shows the bare reference."""
    found = reading.displacement
    panels: list[tuple[str, str, Float, bool]] = [
        ("du, to the right = positive", "px", found.du, True),
        ("dv, downwards = positive", "px", found.dv, True),
        ("sigma of a component", "px", found.sigma, False),
    ]
    shown = [
        (title, unit, np.where(found.valid, field, np.nan), signed) for title, unit, field, signed in panels
    ]
    extent = _extent(found.u, found.v)
    rows, cols = reference.shape
    count = 4 if reading.grid is not None else 3
    with mpl.rc_context({"font.size": 8, "axes.titlesize": 9}):
        across, down = (2, 2) if count == 4 or cols > 1.5 * rows else (3, 1)
        height = 6.0 * rows / cols * down + 0.8
        figure = Figure(figsize=(6.6 * across, min(max(height, 4.0), 16.0)), layout="constrained")
        axes = figure.subplots(down, across, squeeze=False).ravel()
        for axis, (title, unit, field, signed) in zip(axes, shown, strict=False):
            _overlay(axis, reference, field, extent, title, unit, signed=signed)
        if reading.surface is not None and reading.grid is not None:
            u, v = reading.grid.mesh()
            depth_um = np.where(reading.surface.valid, _DEPTH_UNIT_UM * reading.surface.depth_mm, np.nan)
            title = "depth at the image's pixels, into the rubber = positive"
            _overlay(axes[3], reference, depth_um, _extent(u, v), title, "um", signed=True)
        elif reading.grid is not None:
            axes[3].text(0.5, 0.5, "no depth could be read", ha="center", transform=axes[3].transAxes)
        for axis in axes[count:] if count < len(axes) else []:
            axis.set_axis_off()
        figure.suptitle(f"{reading.name}: {found.valid.mean():.1%} of the points valid")
        figure.savefig(path, dpi=100)


def _extent(u: Float, v: Float) -> tuple[float, float, float, float]:
    """Borders (left, right, bottom, top) of the image that shows one pixel per point."""
    half_u, half_v = 0.5 * (u[0, 1] - u[0, 0]), 0.5 * (v[1, 0] - v[0, 0])
    return u[0, 0] - half_u, u[0, -1] + half_u, v[-1, 0] + half_v, v[0, 0] - half_v


def _overlay(
    axis: Axes,
    reference: Image,
    field: Float,
    extent: tuple[float, float, float, float],
    title: str,
    unit: str,
    *,
    signed: bool,
) -> None:
    """Field in colours over the reference; symmetric round zero, or from zero up."""
    rows, cols = reference.shape
    axis.imshow(reference, cmap="gray")
    finite = np.abs(field[np.isfinite(field)])
    high = float(np.percentile(finite, 99.5)) if finite.size else 1.0
    colours = axis.imshow(
        field,
        cmap="RdBu_r" if signed else "viridis",
        vmin=-high if signed else 0.0,
        vmax=high or 1.0,
        extent=extent,
        alpha=_ALPHA,
        interpolation="nearest",
    )
    axis.set_xlim(-0.5, cols - 0.5)
    axis.set_ylim(rows - 0.5, -0.5)
    axis.set_title(title)
    axis.set_xlabel("u, px")
    axis.set_ylabel("v, px")
    assert axis.figure is not None
    axis.figure.colorbar(colours, ax=axis, label=unit, shrink=0.8)
