"""A calibration as one picture: rest map, what was left out, misfit, light, presses, depth's error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib.figure import Figure

from zeromethod.commissioning.calibration.evaluation import Calibration, rest_residuals
from zeromethod.view.axes import save
from zeromethod.warp.rest_map import Reason, plain_name


def draw_calibration(found: Calibration, path: Path) -> None:
    """Write the picture (.png)."""
    figure = Figure(figsize=(13.5, 8.0), layout="constrained")
    axes = figure.subplots(2, 3)
    rest = found.rest.rest_map
    for axis, component, name in ((axes[0, 0], 0, "column"), (axes[0, 1], 1, "row")):
        image = axis.imshow(rest.lcd_px[..., component], cmap="viridis")
        figure.colorbar(image, ax=axis, shrink=0.8, label="LCD px")
        axis.set_title(f"rest map: LCD {name} that each camera pixel sees", fontsize=9)
    _reasons(axes[0, 2], found)
    _misfit(figure, axes[1, 0], found)
    _depth(axes[1, 1], found)
    _presses(axes[1, 2], found)
    for axis in axes[0]:
        axis.set(xlabel="u, px", ylabel="v, px")
    figure.suptitle(
        f"{found.recorded.rig.name}: {found.verdict.level}; depth to {found.depth_percent:.2f} % by geometry",
        fontsize=11,
    )
    save(figure, path)


def _reasons(axis: Any, found: Calibration) -> None:
    reason = found.rest.rest_map.reason
    mean = found.rest.mean
    axis.imshow(mean, cmap="gray", vmin=0, vmax=max(1.25 * float(mean.max()), 1.0))
    for number, one in enumerate(Reason):
        rows, cols = np.nonzero(reason & int(one))
        if len(rows):
            thin = max(1, len(rows) // 4000)
            label = f"{plain_name(one)} ({len(rows)})"
            axis.plot(cols[::thin], rows[::thin], ".", ms=2, color=f"C{number}", label=label)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=7, loc="lower left")
    axis.set_title("mean light, and pixels left out", fontsize=9)


def _misfit(figure: Figure, axis: Any, found: Calibration) -> None:
    pixel, residual = rest_residuals(found)
    size = np.linalg.norm(residual, axis=-1)
    top = float(np.percentile(size, 98)) or 1.0
    dots = axis.scatter(pixel[:, 0], pixel[:, 1], c=size, s=5, cmap="magma", vmin=0, vmax=top)
    figure.colorbar(dots, ax=axis, shrink=0.8, label="LCD px")
    axis.invert_yaxis()
    axis.set(xlabel="u, px", ylabel="v, px", aspect="equal")
    rms = float(np.sqrt(np.mean(size**2)))
    axis.set_title(f"rest map less fitted geometry, {rms:.3f} LCD px rms", fontsize=9)


def _depth(axis: Any, found: Calibration) -> None:
    error = found.error
    axis.scatter(error.x_mm, error.y_mm, s=60, color="0.85")
    for x, y, percent in zip(error.x_mm, error.y_mm, error.percent, strict=True):
        axis.annotate(f"{percent:.2f} %", (x, y), ha="center", va="center", fontsize=9)
    for number, press in enumerate(found.peaks, start=1):
        axis.plot(press.x_mm, press.y_mm, "x", color="C3")
        axis.annotate(f" press {number}", (press.x_mm, press.y_mm), color="C3", fontsize=8, va="bottom")
    axis.margins(0.15)
    axis.set(xlabel="x on the mirror, mm", ylabel="y, mm")
    axis.set_title("depth's standard deviation by geometry", fontsize=9)


def _presses(axis: Any, found: Calibration) -> None:
    plan = found.recorded.plan
    if not found.peaks:
        axis.axis("off")
        axis.text(0.5, 0.5, "no press of known depth", ha="center", va="center")
        return
    known = np.array(plan.press_depths_mm)
    read = np.array([one.depth_mm for one in found.peaks])
    number = np.arange(1, len(known) + 1)
    axis.errorbar(number, 1e3 * (read - known), yerr=1e3 * plan.press_sigma_mm, fmt="o", capsize=4)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.set(xlabel="press", ylabel="µm", xticks=number)
    axis.set_title("depth read less depth known", fontsize=9)
