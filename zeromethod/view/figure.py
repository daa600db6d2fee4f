"""The picture of a run: camera frames, the warps, and what was read off them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zeromethod.arrays import Float, Image
from zeromethod.contact import Contact, closed, pressure_map
from zeromethod.devices.protocols import TrueMirror
from zeromethod.errors import InputError, check_type
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.step import Step
from zeromethod.session.result import RunResult
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.surface import Surface
from zeromethod.view.axes import (
    centred,
    colour_bar,
    colours,
    labelled,
    over_mirror,
    picture,
    pixels_over_mirror,
)
from zeromethod.view.contact_picture import draw_contact
from zeromethod.view.events_figure import draw_approaches, draw_pointers
from zeromethod.view.table import force_words
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag

CROP_PX = (480, 360)
"""Columns and rows of the camera image that are shown, round the press: the pattern stays visible."""


def plot_run(run: Session | RunResult, path: str | Path | None = None) -> Figure:
    """Plot a run: what the camera saw, what was drawn to cancel it, what was read off it, all in time.

    Parameters
    ----------
    run : Session or RunResult
        The session, during or after its runs, or its result.
    path : str or Path, optional
        Also save the picture there; the suffix (.png, .svg, .pdf) chooses the format.

    Returns
    -------
    matplotlib.figure.Figure
        Twelve panels; those without data say so. A column more where something touches: its images, and
        the pressure on the largest contact; one where every pixel was read; and one of what a watch camera
        saw come, or of what fingers did on an interactive surface.
    """
    result = run.result if isinstance(run, Session) else run
    check_type("plot_run: run", result, RunResult, "a Session, or its result")
    grid = NodeGrid.of_rig(result.rig)
    shown = result.shown
    touching = [one for one in (shown.contacts if shown is not None else ()) if one.image is not None]
    fine = result.every_pixel
    outside = result.rig.watch is not None or result.rig.projector is not None
    columns = 4 + bool(touching) + (fine is not None) + outside
    with picture(path, (4 * columns, 9.5), _title(summarise(result))) as figure:
        axes = figure.subplots(3, columns)
        if touching:
            _draw_images(axes[:, 4], touching)
            if len(touching) < len(axes) and shown is not None:
                _draw_pressure(axes[-1, 4], result, shown)
        if fine is not None:
            _draw_pixels(axes[:, -1 - outside], fine, result)
        if outside:
            _draw_events(axes[:, -1], result)
        _camera_row(axes[0, :3], result, grid)
        _timeline(axes[2, 3], result)
        read_axes = [axes[0, 3], *axes[1, :4], *axes[2, :3]]
        if shown is None:
            for axis in read_axes:
                _say(axis, "no frame was read" if result.records else "no frame came")
        else:
            _read_maps(read_axes, result, shown)
    return figure


def _named(step: Step) -> str:
    """What a frame is of: part of the scenario, where there is one, and the loop's state."""
    return f"{step.phase}, {step.state}" if step.phase else str(step.state)


def _draw_events(axes: Sequence[Axes], result: RunResult) -> None:
    """What came before it touched, or what fingers did."""
    records, start_ns = result.records, result.start_ns
    if result.rig.watch is not None:
        seen = (one.approach for one in records if one.approach is not None)
        draw_approaches(axes, seen, start_ns)
    else:
        end_ns = records[-1].time_ns if records else start_ns
        draw_pointers(axes, (event for one in records for event in one.pointers), start_ns, end_ns)


def _title(figures: dict[str, Any]) -> str:
    scenario = "" if figures["scenario"] is None else f", {figures['scenario']}"
    parts = [f"zeromethod  rig {figures['rig']}{scenario}, {figures['controller']}"]
    read_mm, truth = figures["depth_peak_mm"], figures["truth"]
    if read_mm is not None:
        until_s = figures["read_until_s"]
        until = "" if until_s is None else f" until {until_s:.2f} s, not nulled since"
        parts.append(f"peak {read_mm:.5f} ± {figures['depth_peak_sigma_mm']:.5f} mm{until}")
    if truth is not None:
        true_mm = truth["depth_deepest_mm"]
        low = f" ({100 * (read_mm / true_mm - 1):+z.2f} %)" if read_mm is not None and true_mm else ""
        parts.append(f"true {true_mm:.5f} mm{low}")
        parts.append(f"rms error of the nodes read {1e3 * truth['depth_rms_error_um']:.0f} nm")
    if (fine := figures.get("fine")) is not None:
        parts.append(f"peak on every pixel {fine['depth_peak_mm']:.5f} mm")
    return "   ".join(parts)


def _say(axis: Axes, words: str) -> None:
    centred(axis, words)
    axis.set_axis_off()


def _camera_row(axes: Image, result: RunResult, grid: NodeGrid) -> None:
    extent = _crop(result.shown, grid)
    columns, rows = slice(*extent[:2]), slice(*extent[2:])
    steps = (result.before, result.worst, result.shown)
    parts = [None if one is None or one.image is None else one.image[rows, columns] for one in steps]
    # one scale of grey for all, so that a darker frame looks darker
    white = max((int(part.max()) for part in parts if part is not None), default=1)
    names = ("camera", "largest residual", "read")
    missing = (
        "no frame was nulled before a press",
        "no frame after one that was nulled",
        "no frame was read",
    )
    for axis, name, step, part, words in zip(axes, names, steps, parts, missing, strict=True):
        if step is None or part is None:
            _say(axis, words)
            continue
        left, right, top, bottom = extent
        axis.imshow(part, cmap="gray", vmin=0, vmax=white, extent=(left, right, bottom, top))
        title = f"{name}: {_named(step)} ({step.time_s:.2f} s)"
        labelled(axis, title, "u, camera px", "v, camera px")


def _crop(read: Step | None, grid: NodeGrid) -> tuple[int, int, int, int]:
    """(first column, last, first row, last) of the camera image round the deepest node."""
    rows, columns = grid.image_shape
    row, column = rows // 2, columns // 2
    if read is not None and read.surface is not None and read.surface.valid.any():
        j, i = _deepest_node(read.surface)
        row, column = int(grid.v_px[j]), int(grid.u_px[i])
    width, height = min(CROP_PX[0], columns), min(CROP_PX[1], rows)
    left = min(max(column - width // 2, 0), columns - width)
    top = min(max(row - height // 2, 0), rows - height)
    return left, left + width, top, top + height


def _deepest_node(surface: Surface) -> tuple[int, int]:
    depth = np.where(surface.valid, np.abs(surface.depth_mm), -1.0)
    row, column = np.unravel_index(np.argmax(depth), depth.shape)
    return int(row), int(column)


def draw_map(
    axis: Axes, surface: Surface, values: Float, title: str, unit: str, *, signed: bool = True
) -> None:
    """Map of the valid nodes over the mirror in mm; colours symmetric round zero, or from zero up."""
    shown = np.where(surface.valid, values, np.nan)
    mesh = over_mirror(axis, surface, shown, **colours(shown, 99.8, signed=signed))
    labelled(axis, title, "x, mm", "y, mm")
    colour_bar(axis, mesh, unit)


def _read_maps(axes: list[Axes], result: RunResult, read: Step) -> None:
    surface, residual, shown, measured = read.surface, read.residual, read.shown, read.measured
    assert surface is not None
    assert residual is not None
    assert shown is not None
    assert measured is not None
    applied_px, measured_px = shown.q - result.rest.q, measured.q - result.rest.q
    # what a window at a seam of thin rubber sees is of two teeth
    seam = measured.flags & Flag.SEAM != 0
    residual_px = np.where(residual.valid & ~seam, np.linalg.norm(residual.d, axis=-1), np.nan)
    masked, across = ("\nseams between teeth: masked", "\ncarried across seams") if seam.any() else ("", "")
    true_mm = None
    if result.true_mirror is not None:
        mirror = result.true_mirror(read.time_ns)
        true_mm = mirror.depth(surface.x_mm, surface.y_mm)
    draw_map(axes[0], surface, residual_px, f"residual: {_named(read)}{masked}", "camera px", signed=False)
    draw_map(axes[1], surface, applied_px[..., 0], "applied warp, along LCD columns", "LCD px")
    draw_map(axes[2], surface, measured_px[..., 0], f"measured warp, along LCD columns{masked}", "LCD px")
    draw_map(axes[3], surface, 1e3 * surface.slope[..., 0], f"slope dd/dx{across}", "mrad")
    draw_map(axes[4], surface, 1e3 * surface.slope[..., 1], f"slope dd/dy{across}", "mrad")
    draw_map(axes[5], surface, surface.depth_mm, f"depth (into the rubber = positive){across}", "mm")
    draw_outlines(axes[5], read.contacts)
    if true_mm is None:
        draw_map(axes[6], surface, 1e6 * surface.sigma_depth_mm, "depth sigma", "nm", signed=False)
    else:
        draw_map(axes[6], surface, 1e6 * (surface.depth_mm - true_mm), "depth error", "nm")
    _section(axes[7], surface, result.true_mirror and result.true_mirror(read.time_ns))


def _draw_pixels(axes: Sequence[Axes], fine: FineSurface, result: RunResult) -> None:
    """Depth on every pixel, its error or sigma, and a section through its peak."""
    truth = None if result.true_mirror is None else result.true_mirror(fine.time_ns)
    depth_mm = fine.depth_mm.astype(np.float64)
    small_nm, title = 1e6 * fine.sigma_depth_mm.astype(np.float64), "depth sigma on every pixel"
    if truth is not None:
        true_mm = truth.depth(fine.x_mm.astype(np.float64), fine.y_mm.astype(np.float64))
        small_nm, title = 1e6 * (depth_mm - true_mm), "depth error on every pixel"
    for axis, values, name, unit, signed in (
        (axes[0], 1e3 * depth_mm, f"depth on every pixel, {fine.frames} frames", "µm", True),
        (axes[1], small_nm, title, "nm", truth is not None),
    ):
        mesh = pixels_over_mirror(axis, fine, values, **colours(values, 99.8, signed=signed))
        labelled(axis, name, "x, mm", "y, mm")
        colour_bar(axis, mesh, unit)
    _, x_mm, y_mm = fine.peak
    away = np.nan_to_num(np.hypot(fine.x_mm - x_mm, fine.y_mm - y_mm), nan=np.inf)
    row = int(np.argmin(away)) // away.shape[1]
    axes[2].plot(fine.x_mm[row], 1e3 * fine.depth_mm[row], "C0.", markersize=1, label="read")
    if truth is not None:
        axes[2].plot(fine.x_mm[row], 1e3 * true_mm[row], "C1-", linewidth=1, label="truth")
    axes[2].invert_yaxis()
    labelled(axes[2], "the same, along the row of the peak", "x, mm", "depth, µm")
    axes[2].legend()


def draw_outlines(axis: Axes, contacts: Sequence[Contact]) -> None:
    """Draw the borders of contacts over a map, each with its id."""
    middle = sum(axis.get_xlim()) / 2
    for contact in contacts:
        axis.plot(*closed(contact.outline_mm).T, "k-", linewidth=0.8)
        force = f": {contact.force_n:.3f} N" if np.isfinite(contact.force_n) else ""
        # beside it, where there is more room
        right = contact.x_mm < middle
        edge_mm = contact.outline_mm[:, 0].max() if right else contact.outline_mm[:, 0].min()
        axis.annotate(
            f"{contact.id}{force}", (edge_mm, contact.y_mm), (8 if right else -8, 0),
            textcoords="offset points", ha="left" if right else "right", va="center",
        )  # fmt: skip


def _draw_images(axes: Sequence[Axes], contacts: Sequence[Contact]) -> None:
    """Images of the largest contacts, one to a panel."""
    for axis in axes[len(contacts) :]:
        axis.set_axis_off()
    for axis, contact in zip(axes, contacts, strict=False):
        assert contact.image is not None
        draw_contact(axis, contact.image, contact.outline_mm, f"contact {contact.id}")


def _draw_pressure(axis: Axes, result: RunResult, read: Step) -> None:
    """How the pressure is spread over the largest contact, or why that is not known."""
    assert read.surface is not None
    contact = read.contacts[0]
    try:
        found = pressure_map(result.rig, read.surface, read.contacts)
    except InputError as error:
        _say(axis, textwrap.fill(str(error), 40))
        return
    axis.set_axis_on()
    most = int(np.argmax(found.pressure_mpa))
    kpa, high = 1e3 * found.pressure_mpa, 1e3 * found.pressure_mpa[most]
    look = colours(np.array([high]), 100, signed=found.sticks)
    mesh = axis.tripcolor(found.x_mm, found.y_mm, kpa, shading="gouraud", **look)
    axis.set_aspect("equal")
    title = f"pressure, contact {contact.id}{', which sticks' if found.sticks else ''}"
    force = force_words(contact.force_n, contact.sigma_force_n)
    title += f"\nmaximum {high:.1f} ± {1e3 * found.sigma_mpa[most]:.1f} kPa\n{force}"
    labelled(axis, title, "x, mm", "y, mm")
    colour_bar(axis, mesh, "kPa")


def _section(axis: Axes, surface: Surface, truth: TrueMirror | None) -> None:
    """Depth along the row of nodes through the deepest one, with what was carried in, and the truth."""
    inside = surface.inside
    row, _ = _deepest_node(inside or surface)
    parts = [_section_points(surface, row)] + ([] if inside is None else [_section_points(inside, row)])
    axis.plot(parts[0][0], parts[0][2], ".", markersize=4, label="read")
    for x_mm, _, depth_mm, sigma_mm in parts[1:]:
        axis.errorbar(x_mm, depth_mm, sigma_mm, fmt="C0x", markersize=4, linewidth=0.6, label="carried in")
    if truth is not None:
        known = np.any([one.valid[row] for one in (surface, inside) if one is not None], axis=0)
        x_mm, y_mm = surface.x_mm[row], surface.y_mm[row]
        true_mm = np.full(x_mm.shape, np.nan)  # where the line breaks
        true_mm[known] = truth.depth(x_mm[known], y_mm[known])
        axis.plot(x_mm, true_mm, "C1-", linewidth=1, label="truth")
    axis.invert_yaxis()
    labelled(axis, "section through the peak (into the rubber = down)", "x, mm", "depth, mm")
    axis.legend()


def _section_points(surface: Surface, row: int) -> Float:
    """x, y, depth and its sigma, mm, of a row's valid nodes: (4, n)."""
    fields = surface.x_mm, surface.y_mm, surface.depth_mm, surface.sigma_depth_mm
    return np.stack([field[row][surface.valid[row]] for field in fields])


def _timeline(axis: Axes, result: RunResult) -> None:
    time_s = [record.time_s for record in result.records]
    axis.plot(time_s, [record.depth_peak_mm for record in result.records], ".-", color="C0", markersize=3)
    axis.set_xlabel("time, s")
    axis.set_ylabel("peak depth, mm", color="C0")
    axis.set_title("peak depth and residual over the run")
    right = axis.twinx()
    right.semilogy(time_s, [record.residual_rms_px for record in result.records], color="C1", linewidth=0.8)
    right.set_ylabel("residual rms, camera px", color="C1")
