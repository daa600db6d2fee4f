"""The picture of a run: what the camera saw, what was drawn to cancel it, what was read off it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zeromethod.procedures import RunResult, Snapshot

Array = NDArray[np.float64]


def draw_figure(result: RunResult, figures: dict[str, Any], path: Path) -> None:
    """Write the figure of a run as PNG. Panels without data say so."""
    with mpl.rc_context({"font.size": 8, "axes.titlesize": 9}):
        figure = Figure(figsize=(16, 11), layout="constrained")
        axes = figure.subplots(3, 4)
        _camera_row(axes[0], result)
        if result.nulled is not None:
            _warp_row(axes[1], result.nulled)
            _depth_row(axes[2], result.nulled)
        else:
            for axis in axes[1:, :3].ravel():
                _say(axis, "never nulled")
            _say(axes[1, 3], "never nulled")
        _timeline(axes[2, 3], result)
        figure.suptitle(_title(figures), fontsize=11)
        figure.savefig(path, dpi=110)


def _title(figures: dict[str, Any]) -> str:
    parts = [f"zeromethod  rig {figures['rig']}, press {figures['press']}, {figures['controller']}"]
    if figures["depth_peak_mm"] is not None:
        parts.append(f"peak {figures['depth_peak_mm']:.5f} mm")
    if figures["truth"] is not None:
        parts.append(f"truth {figures['truth']['depth_peak_mm']:.5f} mm")
        parts.append(f"rms error {1e3 * figures['truth']['depth_rms_error_um']:.0f} nm")
    return "   ".join(parts)


def _say(axis: Axes, words: str) -> None:
    axis.text(0.5, 0.5, words, ha="center", va="center", transform=axis.transAxes)
    axis.set_axis_off()


def _camera_row(axes: NDArray[Any], result: RunResult) -> None:
    for axis, name, snapshot in zip(
        axes, ("before", "pressed", "nulled"), (result.before, result.pressed, result.nulled), strict=False
    ):
        if snapshot is None:
            _say(axis, f"no frame {name}")
            continue
        top = int(np.percentile(snapshot.image, 99.9)) + 1
        axis.imshow(snapshot.image, cmap="gray", vmin=0, vmax=top, interpolation="antialiased")
        axis.set_title(f"camera, {name} ({snapshot.time_s:.2f} s)")
        axis.set_xlabel("u, camera px")
        axis.set_ylabel("v, camera px")
    axis = axes[3]
    if result.nulled is None:
        _say(axis, "never nulled")
    else:
        length = np.linalg.norm(result.nulled.residual_px, axis=-1)
        _map(axis, result.nulled, length, "residual when nulled", "camera px", "viridis", low=0.0)


def _map(
    axis: Axes,
    snapshot: Snapshot,
    values: Array,
    title: str,
    unit: str,
    colours: str,
    *,
    low: float | None = None,
    mask: bool = True,
) -> None:
    """Node map over the mirror in mm; symmetric round zero unless `low` is given."""
    surface = snapshot.surface
    inside = np.isfinite(surface.x_mm) & np.isfinite(surface.y_mm)
    rows, cols = np.any(inside, axis=1), np.any(inside, axis=0)
    x, y = surface.x_mm[np.ix_(rows, cols)], surface.y_mm[np.ix_(rows, cols)]
    shown = np.where(surface.valid, values, np.nan) if mask else values
    shown = shown[np.ix_(rows, cols)]
    finite = shown[np.isfinite(shown)]
    high = float(np.percentile(np.abs(finite), 99.8)) if finite.size else 1.0
    mesh = axis.pcolormesh(
        _filled(x), _filled(y), shown, cmap=colours, vmin=-high if low is None else low, vmax=high or 1.0, shading="nearest"
    )
    axis.set_aspect("equal")
    axis.set_title(title)
    axis.set_xlabel("x, mm")
    axis.set_ylabel("y, mm")
    axis.figure.colorbar(mesh, ax=axis, label=unit, shrink=0.8)


def _filled(values: Array) -> Array:
    """Coordinates of unread nodes replaced by their neighbours', which pcolormesh needs."""
    if np.all(np.isfinite(values)):
        return values
    mean = np.nanmean(values, axis=0, keepdims=True) if values.shape[0] > 1 else values
    return np.where(np.isfinite(values), values, np.broadcast_to(mean, values.shape))


def _warp_row(axes: NDArray[Any], nulled: Snapshot) -> None:
    for axis, values, name in (
        (axes[0], nulled.applied_px, "applied warp, along columns"),
        (axes[1], nulled.measured_px, "measured warp, along columns"),
    ):
        _map(axis, nulled, values[..., 0], name, "LCD px", "RdBu_r")
    for axis, component, name in ((axes[2], 0, "slope dd/dx"), (axes[3], 1, "slope dd/dy")):
        _map(axis, nulled, 1e3 * nulled.surface.slope[..., component], name, "mrad", "RdBu_r")


def _depth_row(axes: NDArray[Any], nulled: Snapshot) -> None:
    surface = nulled.surface
    _map(axes[0], nulled, surface.depth_mm, "depth", "mm", "RdBu_r")
    if nulled.true_depth_mm is None:
        _map(axes[1], nulled, 1e6 * surface.sigma_depth_mm, "depth sigma", "nm", "magma", low=0.0)
    else:
        error = 1e6 * (surface.depth_mm - nulled.true_depth_mm)
        _map(axes[1], nulled, error, "depth error against truth", "nm", "RdBu_r")
    depth = np.where(surface.valid, surface.depth_mm, np.nan)
    row = int(np.unravel_index(np.nanargmax(np.abs(depth)), depth.shape)[0])
    axes[2].plot(surface.x_mm[row], depth[row], ".", markersize=4, label="read")
    if nulled.true_depth_mm is not None:
        true = np.where(surface.valid, nulled.true_depth_mm, np.nan)[row]
        axes[2].plot(surface.x_mm[row], true, "-", linewidth=1, label="truth")
    axes[2].invert_yaxis()
    axes[2].set_title("section through the peak (into the rubber = down)")
    axes[2].set_xlabel("x, mm")
    axes[2].set_ylabel("depth, mm")
    axes[2].legend()


def _timeline(axis: Axes, result: RunResult) -> None:
    time_s = [record.time_s for record in result.records]
    axis.plot(time_s, [record.depth_peak_mm for record in result.records], color="C0")
    axis.set_xlabel("time, s")
    axis.set_ylabel("peak depth, mm", color="C0")
    axis.set_title("peak depth and residual over the run")
    right = axis.twinx()
    right.semilogy(time_s, [record.residual_rms_px for record in result.records], color="C1", linewidth=0.8)
    right.set_ylabel("residual rms, camera px", color="C1")
