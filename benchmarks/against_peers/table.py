"""The figures of `benchmarks.against_peers`, one section per part; whatever was not measured is left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from benchmarks.against_peers.integration import CASES
from zeromethod.view.table import text_table, titled

Figures = dict[str, Any]

_CASE_WORDS = dict(zip(CASES, ("regular", "irregular", "hole, no corners"), strict=True))
_LOOP_ROWS = {
    "loop": "frame in to warp out",
    "draw": "drawing the pattern",
    "loop_and_draw": "both",
    "read": "reading the surface",
    "read_cold": "the same, from rest",
    "dis_fast": "DIS fast, same frames",
}


def peers_table(figures: Figures, bars: list[Figures]) -> Group:
    """Times are medians; the bars that were judged come last."""
    parts: list[RenderableType] = []
    sections = {
        "displacement": (_near_null, _press),
        "integration": (_integration,),
        "loop": (_loop,),
        "scaling": (_scaling,),
    }
    for key, tables in sections.items():
        for table in tables:
            parts += table(figures.get(key) or {})
    rows = [(bar["name"], bar["value"], bar["bar"], "met" if bar["met"] else "MISSED") for bar in bars]
    return Group(*parts, *_section("Bars", ("", "figure", "bar", ""), rows))


def _section(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[RenderableType]:
    """Title and table, or nothing where there are no rows."""
    return titled(title, text_table(header, rows))


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}" if value < 1 else f"{value:.2f}"


def _mpx(value: float | None) -> str:
    return "" if value is None else f"{1e3 * value:.1f}"


def _size(pair: Sequence[int]) -> str:
    return "x".join(str(n) for n in pair)


def _near_null(figures: Figures) -> list[RenderableType]:
    rows = [
        (
            name,
            _ms(found["null"]["ms"]["median"]),
            _ratio(found["null"]["of_dis_fast"]),
            _mpx(found["null"]["rms_error_px"]),
            _ratio(found.get("error_of_bound")),
            _ratio(found.get("noise_of_bound")),
            str(found["frames_per_reading"]),
        )
        for name, found in figures.get("methods", {}).items()
        if "null" in found
    ]
    size, noise = _size(figures.get("frame_px", ())), figures.get("sigma_grey")
    title = f"Displacement near null, {size}, noise of {noise} grey"
    header = ("method", "ms", "of DIS fast", "rms mpx", "rms/bound", "noise/bound", "frames")
    return _section(title, header, rows)


def _press(figures: Figures) -> list[RenderableType]:
    rows = [
        (
            name,
            _ms(found["press"]["ms"]["median"]),
            _ratio(found["press"]["of_dis_fast"]),
            _mpx(found["press"]["rms_error_px"]),
            _mpx(found["press"]["median_error_px"]),
            f"{100 * found['press']['valid_share']:.1f}",
        )
        for name, found in figures.get("methods", {}).items()
        if "press" in found
    ]
    title = f"Displacement under a press of {figures.get('press_px')} px, one step"
    return _section(title, ("method", "ms", "of DIS fast", "rms mpx", "median mpx", "valid %"), rows)


def _integration(figures: Figures) -> list[RenderableType]:
    rows = [
        (
            name,
            words,
            _ms(found[case]["ms"]["median"]),
            f"{found[case]['error_percent']:.2g}",
            f"{found[case]['noisy_error_percent']:.2g}" if "noisy_error_percent" in found[case] else "",
        )
        for case, words in _CASE_WORDS.items()
        for name, found in figures.get("methods", {}).items()
        if case in found
    ]
    noise = 1e6 * figures.get("slope_noise_rad", 0.0)
    title = f"Slopes to depth, {_size(figures.get('nodes', ()))} nodes, rms error in % of the peak"
    return _section(title, ("method", "nodes", "ms", "exact slopes", f"{noise:.0f} urad noise"), rows)


def _loop(figures: Figures) -> list[RenderableType]:
    if not figures.get("frames"):
        return []
    rows = []
    for key, words in _LOOP_ROWS.items():
        ms, rate = figures[key], figures.get(f"{key}_fps", {}).get("median")
        ratio = figures.get(f"{key}_of_dis_fast")
        spread = (_ms(ms[name]) for name in ("median", "p90", "p99"))
        rows.append((words, *spread, _ratio(ratio), "" if rate is None else f"{rate:.0f}"))
    size, drawn_by = _size(figures["frame_px"]), figures["gl_renderer"]
    title = f"Whole loop, {size}, {figures['frames']} frames, drawn by {drawn_by}"
    parts = _section(title, ("", "ms median", "p90", "p99", "of DIS fast", "frames/s"), rows)
    noise = figures.get("depth_noise")
    if noise:
        rows = [
            ("one frame", f"{noise['depth_rms_nm']:.1f}"),
            ("filtered", f"{noise['depth_filtered_rms_nm']:.1f}"),
        ]
        parts += _section("Depth noise untouched", ("", "nm rms"), rows)
    return parts


def _scaling(figures: Figures) -> list[RenderableType]:
    sizes = figures.get("sizes_px", [])
    rows = []
    for name, found in figures.get("methods", {}).items():
        times = [_ms(ms) for ms in found["ms"]] + [""] * (len(sizes) - len(found["ms"]))
        exponent, memory = found.get("time_exponent"), found.get("memory_mb")
        grows = "" if exponent is None else f"{exponent:.2f}"
        rows.append((name, *times, grows, "" if memory is None else f"{memory[-1]:.1f}"))
    title = "Growth: ms by frame, exponent of time over pixels, peak MB at the largest"
    parts = _section(title, ("method", *(_size(size) for size in sizes), "px^", "MB"), rows)
    note = figures.get("memory_note")
    return [*parts, Text(f"Memory: {note}"), Text()] if note else parts
