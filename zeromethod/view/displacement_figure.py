"""The picture of one measured still image: displacement, sigma and, with a rig, depth, over the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from zeromethod.arrays import Float, Image
from zeromethod.passive.measure import StillReading
from zeromethod.view.axes import centred, colour_bar, colours, labelled, picture

_ALPHA = 0.7
_DEPTH_UNIT_UM = 1e3


def draw_displacement(reading: StillReading, reference: Image, path: Path) -> None:
    """Write the picture of a reading as PNG. What is not valid shows the bare reference."""
    found = reading.displacement
    panels = [
        ("du, to the right = positive", "px", np.where(found.valid, found.du, np.nan), True),
        ("dv, downwards = positive", "px", np.where(found.valid, found.dv, np.nan), True),
        ("sigma of a component", "px", np.where(found.valid, found.sigma, np.nan), False),
    ]
    rows, cols = reference.shape
    count = 4 if reading.grid is not None else 3
    across, down = (2, 2) if count == 4 or cols > 1.5 * rows else (3, 1)
    height = min(max(6.0 * rows / cols * down + 0.8, 4.0), 16.0)
    title = f"{reading.name}: {found.valid.mean():.1%} of the points valid"
    with picture(path, (6.6 * across, height), title) as figure:
        axes = figure.subplots(down, across, squeeze=False).ravel()
        for axis, panel in zip(axes, panels, strict=False):
            _overlay(axis, reference, _extent(found.u, found.v), *panel)
        if reading.surface is not None and reading.grid is not None:
            depth_um = np.where(reading.surface.valid, _DEPTH_UNIT_UM * reading.surface.depth_mm, np.nan)
            kind = "depth" if reading.calibrated else "relative depth (not calibrated)"
            heading = f"{kind} at the image's pixels, into the rubber = positive"
            _overlay(axes[3], reference, _extent(*reading.grid.mesh()), heading, "µm", depth_um, True)
        elif reading.grid is not None:
            centred(axes[3], "no depth could be read")
        for axis in axes[count:]:
            axis.set_axis_off()


def _extent(u: Float, v: Float) -> tuple[float, float, float, float]:
    """Borders (left, right, bottom, top) of the image that shows one pixel per point."""
    half_u, half_v = 0.5 * (u[0, 1] - u[0, 0]), 0.5 * (v[1, 0] - v[0, 0])
    return u[0, 0] - half_u, u[0, -1] + half_u, v[-1, 0] + half_v, v[0, 0] - half_v


def _overlay(
    axis: Axes,
    reference: Image,
    extent: tuple[float, float, float, float],
    title: str,
    unit: str,
    field: Float,
    signed: bool,
) -> None:
    """Field in colours over the reference; symmetric round zero, or from zero up."""
    rows, cols = reference.shape
    axis.imshow(reference, cmap="gray")
    limits = colours(field, 99.5, signed=signed)
    shown = axis.imshow(field, extent=extent, alpha=_ALPHA, interpolation="nearest", **limits)
    axis.set_xlim(-0.5, cols - 0.5)
    axis.set_ylim(rows - 0.5, -0.5)
    labelled(axis, title, "u, px", "v, px")
    colour_bar(axis, shown, unit)
