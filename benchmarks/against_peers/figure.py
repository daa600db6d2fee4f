"""The picture of `benchmarks.against_peers`: time against error over the bound, and growth with the frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from benchmarks.against_peers import MOST_OF_BOUND, MOST_OF_DIS_FAST
from benchmarks.against_peers.methods import DIS_FAST, RESIDUAL
from zeromethod.view.axes import centred, picture

Figures = dict[str, Any]

_MARKERS = "osD^vP"


def draw_peers(figures: Figures, path: Path) -> None:
    """Write the figure as PNG. A panel whose part was not measured says so."""
    host = figures["host"]
    title = f"{host['machine']}, {host['cores']} cores, {host['threads']} thread, OpenCV {host['opencv']}"
    with picture(path, (14, 6), f"zeromethod against peers  {title}", font=9) as figure:
        left, right = figure.subplots(1, 2)
        _against_bound(left, figures.get("displacement") or {})
        _growth(right, figures.get("scaling") or {})


def _say(axis: Axes, words: str) -> None:
    centred(axis, words)
    axis.set_axis_off()


def _against_bound(axis: Axes, figures: Figures) -> None:
    methods = {name: found for name, found in figures.get("methods", {}).items() if "error_of_bound" in found}
    if DIS_FAST not in methods:
        _say(axis, "displacement: not measured")
        return
    for index, (name, found) in enumerate(methods.items()):
        ms, error = found["null"]["ms"]["median"], found["error_of_bound"]
        marker, size = ("*", 15) if name == RESIDUAL else (_MARKERS[index % len(_MARKERS)], 8)
        frames = found["frames_per_reading"]
        label = name if frames == 1 else f"{name}: {frames} frames"
        axis.plot(ms, error, marker, color=f"C{index}", markersize=size, label=label)
        axis.plot([ms, ms], sorted([error, found["noise_of_bound"]]), "-", color=f"C{index}", linewidth=0.8)
    fast = methods[DIS_FAST]["null"]["ms"]["median"]
    axis.axhline(1.0, color="k", linewidth=0.8)
    axis.axhline(MOST_OF_BOUND, color="0.6", linewidth=0.8, linestyle=":")
    axis.axvline(MOST_OF_DIS_FAST * fast, color="0.6", linewidth=0.8, linestyle=":")
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="time per reading, ms",
        ylabel="rms error near null / Cramer-Rao bound of its window",
    )
    axis.set_ylim(bottom=0.8)
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(ScalarFormatter())
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.legend(fontsize=8)
    frame = "x".join(str(n) for n in figures["frame_px"])
    axis.set_title(
        f"displacement, {frame} (dotted: {MOST_OF_BOUND} of the bound, {MOST_OF_DIS_FAST} of DIS fast; "
        "lines: down to the noise alone)"
    )


def _growth(axis: Axes, figures: Figures) -> None:
    methods: Figures = figures.get("methods", {})
    sizes = figures.get("sizes_px", [])
    if not methods:
        _say(axis, "growth with the frame: not measured")
        return
    for index, (name, found) in enumerate(methods.items()):
        megapixels = [cols * rows / 1e6 for cols, rows in sizes[: len(found["ms"])]]
        axis.plot(megapixels, found["ms"], "o-", color=f"C{index}", markersize=4, label=name)
    axis.set(xscale="log", yscale="log", xlabel="camera megapixels", ylabel="time, ms")
    axis.set_title("growth with the frame")
    axis.legend(fontsize=8)
