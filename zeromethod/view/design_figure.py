"""Pictures of a bench: prism and rays true to scale in the plane y = 0, maps over the mirror, and curves."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.tri import Triangulation

from zeromethod.arrays import Float
from zeromethod.design.lever import camera_px_per_mrad, depth_nm_per_px
from zeromethod.design.press_limits import nulled_mm
from zeromethod.design.ray_paths import RayPath, ray_paths
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.tir import margin_deg
from zeromethod.optics import Lost
from zeromethod.optics.prism import Face
from zeromethod.rig.model import Layer
from zeromethod.view.axes import colour_bar, labelled, picture
from zeromethod.view.design_table import CURVES

_RAYS = 9
_MARGIN_MM = 7.0
_PANEL_MM = 1.5
_EVEN = 0.01
_LONGEST = 4.0
"""Triangles with a side this many times as long as others' bridge gaps in the view."""
_RUBBER, _PLATE, _GAP = "#dcebf7", "#c9d8c2", "#f5f5f5"


def draw_design(view: SampledView, figures: dict[str, Any], path: Path) -> None:
    """Write the drawing of a bench with its maps as PNG."""
    with picture(path, (15, 10), _title(figures)) as figure:
        grid = figure.add_gridspec(2, 1, height_ratios=(1.75, 1))
        top = grid[0].subgridspec(1, 2, width_ratios=(1.2, 1))
        whole, near = figure.add_subplot(top[0, 0]), figure.add_subplot(top[0, 1])
        rays = ray_paths(view.optics, *_pixels(view))
        for axis in (whole, near):
            _bench(axis, view, rays)
        _label_whole(whole, view, rays)
        _label_near(near, view, figures)
        maps = grid[1].subgridspec(1, 5)
        for k, (title, unit, values) in enumerate(_maps(view, figures)):
            _map(figure.add_subplot(maps[0, k]), view, values, title, unit)
        _carrier(figure.add_subplot(maps[0, 4]), figures["carrier"])


def _title(figures: dict[str, Any]) -> str:
    tir = figures["tir"]
    return (
        f"zeromethod design  rig {figures['rig']}   critical angle {tir['critical_deg']:.2f} deg, "
        f"centre ray {tir['centre_incidence_deg']:.2f} deg, "
        f"least margin {tir['least_margin_deg']:+z.2f} deg   "
        f"round the loop {figures['delay']['mean_frames']:.1f} frames"
    )


def _pixels(view: SampledView) -> tuple[Float, Float]:
    """Pixels from edge to edge of the image, through its middle, along which x on the mirror grows."""
    camera = view.rig.camera
    middle = np.array([(camera.columns - 1) / 2, (camera.rows - 1) / 2])
    growth = np.nanmedian(view.mirror_per_camera[..., 0, :][view.on_lcd], axis=0)
    direction = growth / np.linalg.norm(growth)
    with np.errstate(divide="ignore"):
        reach = float(np.min(middle / np.abs(direction)))
    along = np.linspace(-reach, reach, _RAYS)
    return middle[0] + along * direction[0], middle[1] + along * direction[1]


def _slab(face: Face, from_mm: float, to_mm: float) -> Float:
    """(4, 2) corners x, z of a slab parallel to a face, between two distances from it."""
    corners = [face.edge + from_mm * face.normal, face.end_mm + from_mm * face.normal]
    corners += [face.end_mm + to_mm * face.normal, face.edge + to_mm * face.normal]
    return np.array(corners)[:, [0, 2]]


def _outline(view: SampledView) -> Float:
    """(n, 2) corners x, z of the rubber: P0, R0, apex of a prism; of a saw its valleys and tips as well."""
    prism, saw = view.optics.prism, view.optics.saw
    if saw is None:
        return np.array([prism.pattern_face.edge, prism.camera_face.edge, prism.apex_mm])[:, [0, 2]]
    corners = [np.zeros(3), np.array([prism.length_mm, 0.0, 0.0])]
    for pattern, camera in zip(saw.pattern[::-1], saw.camera[::-1], strict=True):
        corners += [camera.edge, pattern.end_mm, pattern.edge]
    return np.array(corners)[:, [0, 2]]


def _panel_line(view: SampledView) -> Float:
    """(2, 2) ends x, z of the LCD's pixel area where it crosses the plane y = 0."""
    columns, rows = view.rig.display.columns - 0.5, view.rig.display.rows - 0.5
    corners = view.optics.lcd_to_world(
        np.array([[-0.5, -0.5], [columns, -0.5], [columns, rows], [-0.5, rows], [-0.5, -0.5]])
    )
    found = []
    for first, second in pairwise(corners):
        if (first[1] < 0.0) != (second[1] < 0.0):
            share = first[1] / (first[1] - second[1])
            found.append((first + share * (second - first))[[0, 2]])
    # a panel that does not meet the plane is drawn by its outline's nearest side
    return np.array(found) if len(found) == 2 else corners[:2, [0, 2]]


def _bench(axis: Axes, view: SampledView, rays: list[RayPath]) -> None:
    prism = view.optics.prism
    axis.add_patch(Polygon(_outline(view), closed=True, facecolor=_RUBBER, edgecolor="black", linewidth=0.8))
    stacks = ((prism.pattern_face, view.rig.pattern_layers), (prism.camera_face, view.rig.camera_layers))
    for face, layers in stacks:
        depth = 0.0
        for layer in layers:
            colour = _GAP if layer.index == 1.0 else _PLATE
            slab = _slab(face, depth, depth + layer.thickness_mm)
            axis.add_patch(Polygon(slab, closed=True, facecolor=colour, edgecolor="0.5", linewidth=0.4))
            depth += layer.thickness_mm
    # only the panel's front is known: its thickness is for the eye
    front = _panel_line(view)
    back = front + _PANEL_MM * view.optics.panel.normal[[0, 2]]
    axis.add_patch(Polygon(np.vstack([front, back[::-1]]), closed=True, facecolor="black", zorder=4))
    x = np.linspace(0.0, view.optics.length_mm, 200)
    axis.plot(x, view.optics.rest.height(x, np.zeros_like(x)), color="#b03060", linewidth=2.0, zorder=4)
    for ray in rays:
        axis.plot(ray.points[:, 0], ray.points[:, 2], **_traced(ray.lost)[1], zorder=3)
    axis.set_aspect("equal")
    axis.set_xlabel("x, mm")
    axis.set_ylabel("z, mm")


_TRACED: dict[Lost, tuple[str, dict[str, Any]]] = {
    Lost.NONE: ("totally reflected", {"color": "#2a7fbf"}),
    Lost.BELOW_TIR: ("below the critical angle", {"color": "#e08a1e", "linestyle": "--"}),
}


def _traced(lost: Lost) -> tuple[str, dict[str, Any]]:
    """Name and look of a ray."""
    name = f"lost: {lost.name.lower().replace('_', ' ')}"
    name, look = _TRACED.get(lost, (name, {"color": "#a0a0a0", "linestyle": ":"}))
    return name, {"linewidth": 0.9, **look}


def _say(axis: Axes, text: str, at: Float, offset: tuple[float, float], **more: Any) -> None:
    """Label at a point (x, z), moved by an offset in typographic points, legible across rays."""
    axis.annotate(
        text, (float(at[0]), float(at[1])), xytext=offset, textcoords="offset points",
        ha="center", va="center", zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.0}, **more,
    )  # fmt: skip


def _label_whole(axis: Axes, view: SampledView, rays: list[RayPath]) -> None:
    camera = view.optics.camera
    starts = np.array([ray.points[0] for ray in rays])[:, [0, 2]]
    if camera.spec.projection == "orthographic":
        axis.plot(*starts[[0, -1]].T, color="black", linewidth=3.5, solid_capstyle="butt")
        name = "camera (parallel rays)"
    else:
        axis.plot(*starts[0], "o", color="black", markersize=6)
        name = "camera"
    distance = np.linalg.norm(camera.position - np.array(camera.spec.look_at_mm))
    at = starts[np.argmin(starts[:, 0])]
    _say(axis, f"{name}\n{distance:.0f} mm from the mirror", at, (-62, -4))
    axis.set_title("the bench, true to scale, in the plane y = 0")
    axis.margins(0.08)
    found = sorted({ray.lost for ray in rays}, key=lambda lost: (lost not in _TRACED, lost))
    lines = [Line2D([], [], label=name, **look) for name, look in map(_traced, found)]
    lines.append(Line2D([], [], color="#b03060", linewidth=2.0, label="mirror"))
    lines.append(Line2D([], [], color="black", linewidth=3.5, label="LCD"))
    axis.legend(handles=lines, loc="lower left", framealpha=0.9)


def _label_near(axis: Axes, view: SampledView, figures: dict[str, Any]) -> None:
    prism, rig = view.optics.prism, view.rig
    panel = _panel_line(view)
    corners = _outline(view)
    points = np.vstack([corners, panel])
    low, high = points.min(axis=0) - _MARGIN_MM, points.max(axis=0) + _MARGIN_MM
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1] + _MARGIN_MM)
    axis.set_title("prism, layers and LCD, true to scale")
    _say(axis, f"P0, {rig.prism.pattern_angle_deg:.4g}°", corners[0], (16, 12))
    _say(axis, f"R0, {rig.prism.camera_angle_deg:.4g}°", corners[1], (-4, 12))
    _say(axis, f"mirror, {prism.length_mm:.1f} mm", np.array([prism.length_mm / 2, 0.0]), (0, 12))
    _say(axis, f"index {rig.prism.index:.4g}", corners.mean(axis=0), (0, 0))
    # the LCD's label lies beyond its end, away from the prism, where no ray goes
    normal = prism.pattern_face.normal[[0, 2]]
    name = f"LCD, {rig.display.columns} x {rig.display.rows} px of {rig.display.pitch_mm:g} mm"
    angle = float(np.degrees(np.arctan2(*(panel[1] - panel[0])[::-1])))
    upright = (angle + 90) % 180 - 90
    middle = panel.mean(axis=0)
    _say(axis, name, middle, tuple(18 * normal), rotation=upright, rotation_mode="anchor")
    words = [
        _layer_words("pattern face to LCD", rig.pattern_layers),
        _layer_words("camera face to air", reversed(rig.camera_layers)),
        f"camera px per mrad of slope along x: {_range(figures, 'camera_px_per_mrad')}",
        f"nm of depth per camera px along x: {_range(figures, 'depth_nm_per_px')}",
    ]
    # under the axis' own label: inside there is no corner that stays free of a thin saw's LCD
    axis.annotate(
        "\n".join(filter(None, words)), (0.0, 0.0), xycoords="axes fraction",
        xytext=(0, -34), textcoords="offset points", va="top",
    )  # fmt: skip


def _range(figures: dict[str, Any], key: str) -> str:
    values = [region[key][0] for region in figures["regions"]]
    return f"{min(values):.3g} to {max(values):.3g}"


def _layer_words(where: str, layers: Iterable[Layer]) -> str:
    words = [
        f"gap {layer.thickness_mm:.3g} mm"
        if layer.index == 1.0
        else f"plate {layer.thickness_mm:.3g} mm (index {layer.index:.4g})"
        for layer in layers
    ]
    return f"{where}: {', '.join(words)}" if words else ""


def _maps(view: SampledView, figures: dict[str, Any]) -> list[tuple[str, str, Float]]:
    press = figures["presses"][min(1, len(figures["presses"]) - 1)]
    return [
        ("margin to the critical angle", "deg", margin_deg(view)),
        ("lever, slope along x", "camera px per mrad", camera_px_per_mrad(view)[..., 0]),
        ("depth, along x", "nm per camera px", depth_nm_per_px(view)[..., 0]),
        (f"press {press['press']} mm: deepest nulled", "µm", 1e3 * nulled_mm(view, press["limits"])),
    ]  # fmt: skip


def _carrier(axis: Axes, found: dict[str, Any]) -> None:
    """Noise and what the LCD can draw, by the carrier's period."""
    periods, depth, drawn = (
        [row[key] for row in found["curve"]] for key in ("period_px", "depth_rms_nm", "drawn_share")
    )
    axis.set_title("period of the carrier")
    axis.set_xlabel("camera px")
    axis.set_ylabel("noise of depth, one frame, nm", color="#2a7fbf")
    axis.plot(periods, depth, "o-", color="#2a7fbf", markersize=3)
    axis.axvline(found["present_px"], color="0.6", linestyle=":")
    axis.axvline(found["advised_px"], color="black", linestyle="--")
    share = axis.twinx()
    share.plot(periods, drawn, "o-", color="#b03060", markersize=3)
    share.axhline(found["wanted_share"], color="#b03060", linewidth=0.6)
    share.set_ylim(0.0, 1.0)
    share.set_ylabel("bend that is nulled, share of fold", color="#b03060")


def _map(axis: Axes, view: SampledView, values: Float, title: str, unit: str) -> None:
    shown = view.on_lcd & np.isfinite(values)
    labelled(axis, title, "x, mm", "y, mm")
    axis.set_aspect("equal")
    if not shown.any():
        return
    x, y, shades = view.x_mm[shown], view.y_mm[shown], values[shown]
    # what grows without bound near P0 would leave no colours for the rest
    low, high = np.percentile(shades, (0, 98))
    if high - low < _EVEN * abs(high):
        low, high = low - _EVEN * abs(high), high + _EVEN * abs(high)
    net = Triangulation(x, y)
    corners = np.stack([x, y], axis=-1)[net.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    net.set_mask(longest > _LONGEST * np.median(longest))
    mesh = axis.tripcolor(
        net, shades, vmin=low, vmax=high, shading="gouraud", cmap="viridis", rasterized=True
    )
    colour_bar(axis, mesh, unit, shrink=0.7, location="bottom")


def draw_curves(found: dict[str, Any], label: str, rig: str, path: Path) -> None:
    """Write the curves of `zeromethod.design.curves` as PNG; a red line where total reflection begins."""
    values = np.array(found["values"])
    with picture(path, (14, 6.5), f"zeromethod design  rig {rig}, {label}") as figure:
        for axis, (title, unit, lines) in zip(figure.subplots(2, 4).flat, CURVES, strict=True):
            for key, _, _, name in lines:
                axis.plot(
                    values, np.array(found[key], dtype=np.float64), ".-", markersize=4, label=name or None
                )
            if unit == "deg":
                axis.axhline(0.0, color="C3", linewidth=0.8)
            if len(lines) > 1:
                axis.legend()
            labelled(axis, title, label, unit)
            axis.set_xlim(values.min(), values.max())
            axis.grid(alpha=0.3)
