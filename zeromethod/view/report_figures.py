"""Pictures of a recording as SVG for a page: lines and letters take the page's own colour.

Letters stay letters, in the page's font; maps of many cells are pixels inside the SVG.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from zeromethod.approach import Approach
from zeromethod.arrays import Float
from zeromethod.contact import ContactImage, closed
from zeromethod.fine.surface import FineSurface
from zeromethod.interactive.pointers import PointerEvent
from zeromethod.loop.state import State
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface
from zeromethod.view.axes import centred, colours, labelled, over_mirror, pixels_over_mirror, plain_log_ticks
from zeromethod.view.contact_picture import draw_contact
from zeromethod.view.events_figure import draw_approaches, draw_pointers
from zeromethod.view.live import STATE_COLOURS
from zeromethod.view.report_history import Episode, episodes, seconds

MOST_POINTS = 2000
"""Points of a curve; of longer ones the least and the largest of each stretch are drawn."""

_INK = "#010203"
"""Stands for the page's colour of text while matplotlib draws."""
_MANY = 300
_FEW = 50
"""Of so few points each is marked: one alone makes no line."""
_RATE_FRAMES = 8
LEAST_RATED = _RATE_FRAMES + 2
"""Frames below which there is no curve of their rate."""
_MAP_INCH = 4.2
_GAP_S = 0.25
"""Longest time between two readings that a line goes across."""
_STYLE: Any = {
    "svg.fonttype": "none",
    "font.size": 9,
    "font.family": "sans-serif",
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "savefig.facecolor": "none",
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.frameon": False,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), _INK),
}


@contextmanager
def _page_style(name: str) -> Iterator[None]:
    """name: makes the ids inside the SVG the figure's own."""
    with mpl.rc_context(_STYLE | {"svg.hashsalt": name}):
        yield


def _svg(figure: Figure, words: str) -> str:
    """The figure as an element of a page; words: what it shows, for those who cannot see it."""
    buffer = io.StringIO()
    figure.savefig(
        buffer, format="svg", dpi=150, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(_INK, "currentColor")
    text = re.sub(r'(<g\b[^>]*) id="[^"]*"', r"\1", text)  # of no use, and the same in every figure
    return text.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)


def depth_map(surface: Surface, peak_mm: tuple[float, float], borders_mm: Sequence[Float] = ()) -> str:
    """Map of depth over the mirror in mm, with its peak marked at (x, y); white is the depth at rest.

    borders_mm: of contacts, (n, 2) each, drawn as lines.

    Where the nodes have no place on the mirror, the picture says so.
    """
    with _page_style(f"depth {surface.time_ns}"):
        shape = _shape(surface.points_mm)
        figure = Figure(figsize=(_MAP_INCH, 1.3 + 0.85 * _MAP_INCH * (shape or 0.5)), layout="constrained")
        axis = figure.subplots()
        labelled(axis, "", "x, mm", "y, mm")
        if shape is None:
            centred(axis, "nothing was read")
            return _svg(figure, "depth over the mirror: nothing")
        depth = np.where(surface.valid, surface.depth_mm, np.nan)
        high = float(np.nanmax(np.abs(depth), initial=0.0))
        factor, unit = (1.0, "mm") if high >= 1.0 else (1e3, "µm") if high >= 1e-3 else (1e6, "nm")
        contact = np.where(surface.contact, 1.0, np.nan)
        over_mirror(axis, surface, contact, cmap="Greys", vmin=0.0, vmax=2.0, rasterized=True)
        mesh = over_mirror(
            axis, surface, factor * depth, rasterized=True, **colours(factor * depth, 100, signed=True)
        )
        if not surface.valid.any():
            centred(axis, "nothing was read")
        for colour, width in (("white", 2.4), ("black", 0.8)):
            axis.plot(*peak_mm, "+", color=colour, markersize=10, markeredgewidth=width)
        for border in borders_mm:
            axis.plot(*closed(border).T, color="black", linewidth=0.8)
        bar = figure.colorbar(mesh, ax=axis, label=f"depth, {unit}", location="bottom", aspect=30)
        assert bar.solids is not None
        bar.solids.set_rasterized(True)
        bar.outline.set_visible(False)
        return _svg(figure, "depth over the mirror")


def pixel_map(surface: FineSurface) -> str:
    """Map of depth on every pixel over the mirror in mm, with its peak marked."""
    with _page_style(f"every pixel {surface.time_ns}"):
        tall = surface.depth_mm.shape[0] / surface.depth_mm.shape[1]
        figure = Figure(figsize=(_MAP_INCH, 1.3 + 0.85 * _MAP_INCH * tall), layout="constrained")
        axis = figure.subplots()
        labelled(axis, "", "x, mm", "y, mm")
        if not surface.valid.any():
            centred(axis, "nothing was read")
            return _svg(figure, "depth on every pixel: nothing")
        high = float(np.nanmax(np.abs(surface.depth_mm)))
        factor, unit = (1.0, "mm") if high >= 1.0 else (1e3, "µm") if high >= 1e-3 else (1e6, "nm")
        depth = factor * surface.depth_mm.astype(np.float64)
        mesh = pixels_over_mirror(axis, surface, depth, **colours(depth, 100, signed=True))
        for colour, width in (("white", 2.4), ("black", 0.8)):
            axis.plot(*surface.peak[1:], "+", color=colour, markersize=10, markeredgewidth=width)
        bar = figure.colorbar(mesh, ax=axis, label=f"depth, {unit}", location="bottom", aspect=30)
        assert bar.solids is not None
        bar.solids.set_rasterized(True)
        bar.outline.set_visible(False)
        return _svg(figure, "depth on every pixel over the mirror")


def events(recording: Recording) -> Iterator[tuple[str, str]]:
    """Heading and picture of what a watch camera saw come, and of what fingers did, as the rig has them."""
    steps, rig = recording.steps, recording.rig
    if not len(steps):
        return
    times_ns = int(steps["time_ns"][0]), int(steps["time_ns"][-1])
    if rig.watch is not None:
        seen = [Approach.of_row(row) for row in recording.tables.approaches()]
        yield "What came", _three("what came", lambda axes: draw_approaches(axes, seen, times_ns[0]))
    if rig.projector is not None:
        said = [PointerEvent.of_row(row) for row in recording.tables.pointers()]
        yield "Pointers", _three("what fingers did", lambda axes: draw_pointers(axes, said, *times_ns))


def _three(words: str, draw: Callable[[Sequence[Axes]], None]) -> str:
    with _page_style(words):
        figure = Figure(figsize=(9.6, 3.0), layout="constrained")
        draw(figure.subplots(1, 3))
        return _svg(figure, words)


def contact_image(image: ContactImage, border_mm: Float | None) -> str:
    """What touches, as an image over the mirror in mm, with its border."""
    with _page_style(f"contact {image.x_mm} {image.y_mm}"):
        rows, cols = image.light.shape
        tall = float(np.clip(rows / cols, 0.3, 2.0))
        figure = Figure(figsize=(0.7 * _MAP_INCH, 0.5 + 0.7 * _MAP_INCH * tall), layout="constrained")
        draw_contact(figure.subplots(), image, border_mm, "")
        return _svg(figure, "what touches, as an image")


def _shape(points_mm: Float) -> float | None:
    """Height over width of the picture that holds the nodes; None where they span nothing."""
    known = points_mm[np.isfinite(points_mm).all(axis=-1)]
    width, height = np.ptp(known, axis=0) if len(known) > 2 else (0.0, 0.0)
    return float(np.clip(height / width, 0.1, 3.0)) if width > 0.0 and height > 0.0 else None


def timeline(recording: Recording) -> str:
    """Residual, peak depth and rate over time, with the states behind them and the drops marked.

    Of fewer than `LEAST_RATED` frames there is no rate.
    """
    steps, peaks, drops = recording.steps, recording.peaks, recording.drops
    time_s = seconds(recording, steps)
    with _page_style("timeline"):
        arrived_s = time_s[steps["frame_number"] >= 0]
        panels = 2 + (len(arrived_s) >= LEAST_RATED)
        figure = Figure(figsize=(9.6, 0.5 + 1.9 * panels), layout="constrained")
        axes = figure.subplots(panels, 1, sharex=True)
        residual, depth, last = axes[0], axes[1], axes[-1]
        states = episodes(recording)
        for axis in axes:
            _shade(axis, states)
        _curve(residual, time_s, np.where(steps["residual_rms_px"] > 0, steps["residual_rms_px"], np.nan))
        if (steps["residual_rms_px"] > 0).any():
            residual.set_yscale("log")
            plain_log_ticks(residual.yaxis)
        residual.set_ylabel("residual rms, camera px")
        _depth(depth, peaks["time_s"], peaks["depth_mm"], peaks["depth_sigma_mm"])
        if panels == 3:
            _rate(last, arrived_s)
        for at in np.unique(np.round(seconds(recording, drops), 2)):
            last.axvline(at, ymax=0.08, color=STATE_COLOURS[State.FAULT], linewidth=1)
        last.set_xlabel("time, s" + ("  (red ticks: frames dropped)" if len(drops) else ""))
        if time_s[-1] > time_s[0]:
            last.set_xlim(time_s[0], time_s[-1])
        found = dict.fromkeys(one.state for one in states if one.end_s > one.start_s)
        handles = [Patch(color=STATE_COLOURS[state], alpha=0.4, label=state) for state in found]
        figure.legend(handles=handles, loc="outside upper left", ncols=max(len(handles), 1))
        return _svg(figure, "residual, peak depth" + (" and rate" if panels == 3 else "") + " over time")


def _shade(axis: Axes, states: list[Episode]) -> None:
    """Each state's times in its colour."""
    for state in dict.fromkeys(one.state for one in states):
        spans = [(one.start_s, one.end_s - one.start_s) for one in states if one.state == state]
        axis.broken_barh(
            spans,
            (0, 1),
            transform=axis.get_xaxis_transform(),
            color=STATE_COLOURS[state],
            alpha=0.25,
            linewidth=0,
            rasterized=len(spans) > _MANY,
        )


def _curve(axis: Axes, time_s: Float, values: Float) -> None:
    axis.plot(*thinned(time_s, values), color=_INK, linewidth=0.8, marker=_marker(values))
    if not np.isfinite(values).any():
        centred(axis, "nothing was measured")


def _depth(axis: Axes, time_s: Float, depth_mm: Float, sigma_mm: Float) -> None:
    gaps = 1 + np.flatnonzero(np.diff(time_s) > _GAP_S)
    time_s, depth_mm, sigma_mm = (np.insert(one, gaps, np.nan) for one in (time_s, depth_mm, sigma_mm))
    x, middle = thinned(time_s, depth_mm)
    low, high = (thinned(time_s, depth_mm + sign * sigma_mm)[1] for sign in (-1, 1))
    axis.fill_between(x, low, high, color=_INK, alpha=0.3, linewidth=0)
    axis.plot(x, middle, color=_INK, linewidth=0.8, marker=_marker(depth_mm))
    axis.set_ylabel("peak depth, mm")
    if not np.isfinite(depth_mm).any():
        centred(axis, "depth was never read")


def _rate(axis: Axes, time_s: Float) -> None:
    """Frames per second, over the last `_RATE_FRAMES` frames each."""
    axis.set_ylabel("frames per second")
    span = time_s[_RATE_FRAMES:] - time_s[:-_RATE_FRAMES]
    rate_hz = _RATE_FRAMES / np.where(span > 0, span, np.nan)
    x, y = thinned(time_s[_RATE_FRAMES:], rate_hz)
    axis.plot(x, y, color=_INK, linewidth=0.8, marker=_marker(rate_hz))
    axis.set_ylim(0, 1.15 * float(np.nanmax(rate_hz, initial=1.0)))


def _marker(values: Float) -> str:
    """Of a curve: points where they are few."""
    return "." if np.isfinite(values).sum() <= _FEW else ""


def thinned(x: Float, y: Float, most: int = MOST_POINTS) -> tuple[Float, Float]:
    """The curve itself, or the least and the largest value of each of `most / 2` stretches, by x.

    No spike is lost, however long the curve; a stretch without a number stays a gap.
    """
    if len(x) <= most:
        return x, y
    edges = np.linspace(0, len(x), most // 2 + 1).astype(int)[:-1]
    known = np.isfinite(y)
    low = np.minimum.reduceat(np.where(known, y, np.inf), edges)
    high = np.maximum.reduceat(np.where(known, y, -np.inf), edges)
    pairs = np.stack([low, high], axis=-1).ravel()
    return np.repeat(x[edges], 2), np.where(np.isfinite(pairs), pairs, np.nan)
