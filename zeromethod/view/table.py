"""Tables on the terminal: what all of them share, and the summary of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

Figures = dict[str, Any]

UNKNOWN = "–"

_DEEPEST = "true peak depth, contacts included"
"""The same as that of what can be read, and left out, where nothing touches."""

LOOP_MS = {False: "loop, frame in to warp out", True: "frame in to measured warp"}
"""What the time of a step is called; of a passive run."""

_RESIDUAL = "residual in the hold"
_PASSIVE = {_RESIDUAL: "displacement seen in the hold, which nothing nulls", LOOP_MS[False]: LOOP_MS[True]}
"""Rows that have another name in a passive run."""

_ROWS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("state at the end", ("state",), "{}"),
    ("frames (dropped)", ("frames", "dropped"), "{} ({})"),
    (
        "exposure that followed the light",
        ("auto_exposure.exposure_ms", "auto_exposure.changes", "auto_exposure.reason"),
        "{:.2f} ms after {} changes: {}",
    ),
    ("frames to lock in the hold", ("lock_frames",), "{}"),
    (_RESIDUAL, ("residual_px_rms",), "{:.4f} camera px rms"),
    ("nodes that see the pattern by the mirror", ("usable_share",), "{:.1%}"),
    ("of these called valid", ("valid_share",), "{:.1%}"),
    ("peak depth read (sigma)", ("depth_peak_mm", "depth_peak_sigma_mm"), "{:.5f} mm ({:.5f})"),
    ("this peak is", ("peak_where",), "{}"),
    ("true peak depth, of what can be read", ("truth.depth_peak_mm",), "{:.5f} mm"),
    (_DEEPEST, ("truth.depth_deepest_mm",), "{:.5f} mm"),
    (
        "peak error, worst frame of the hold (sigma)",
        ("truth.depth_peak_error_percent", "truth.depth_peak_error_sigma_percent"),
        "{:+z.3f} % ({:.3f} %)",
    ),
    ("depth error in the hold", ("truth.depth_rms_error_um",), "{:.4f} µm rms"),
    ("slope error in the hold", ("truth.slope_rms_error_mrad",), "{:.4f} mrad rms"),
    (
        "peak error, worst frame of the slide (sigma)",
        ("truth_slide.depth_peak_error_percent", "truth_slide.depth_peak_error_sigma_percent"),
        "{:+z.3f} % ({:.3f} %)",
    ),
    ("depth error in the slide", ("truth_slide.depth_rms_error_um",), "{:.4f} µm rms"),
    ("depth noise untouched, single frame", ("untouched.depth_rms_nm",), "{:.1f} nm rms"),
    ("depth noise untouched, filtered", ("untouched.depth_filtered_rms_nm",), "{:.1f} nm rms"),
    ("fine surface: pixels", ("fine.cols", "fine.rows"), "{} x {}"),
    ("fine surface: peak depth", ("fine.depth_peak_mm",), "{:.6f} mm"),
    ("fine surface: peak error", ("fine.truth.depth_peak_error_percent",), "{:+z.3f} %"),
    ("fine surface: depth error", ("fine.truth.depth_rms_error_um",), "{:.4f} µm rms"),
    (LOOP_MS[False], ("loop_ms.median", "loop_ms.p99"), "{:.2f} ms (p99 {:.2f})"),
    ("drawing the pattern", ("draw_ms.median", "draw_ms.p99"), "{:.1f} ms (p99 {:.1f})"),
    ("reading the surface", ("read_ms.median", "read_ms.p99"), "{:.1f} ms (p99 {:.1f})"),
    (
        "from mid-exposure to the surface",
        ("surface_latency_ms.median", "surface_latency_ms.p99"),
        "{:.1f} ms (p99 {:.1f})",
    ),
    (
        "frames read to depth (longest gap)",
        ("frames_read", "frames_to_read", "longest_unread"),
        "{} of {} ({})",
    ),
    ("delay of display and camera", ("delay_ms",), "{:.2f} ms"),
    ("stability: times the gain until it swings", ("stability_margin",), "{:.2g}"),
    ("refreshes dropped by the display", ("dropped_refreshes",), "{}"),
    ("GL renderer", ("gl_renderer",), "{}"),
)


def cell(value: Any, pattern: str = "{}") -> str:
    """A figure by its pattern; a dash for None and for what is not finite."""
    unknown = value is None or (isinstance(value, float) and not math.isfinite(value))
    return UNKNOWN if unknown else pattern.format(value)


def text_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    left: Sequence[int] = (0,),
    title: str | None = None,
) -> Table:
    """Table without a frame. left: columns of words, by index; the others are of numbers, to the right."""
    table = Table(box=None, pad_edge=False, title=title, title_justify="left")
    for index, head in enumerate(heads):
        table.add_column(head, justify="left" if index in left else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def pair_table(rows: Iterable[tuple[str, str]]) -> Table:
    """What each figure is, and the figure in words."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    for label, words in rows:
        table.add_row(label, words)
    return table


def titled(title: str, table: Table) -> list[RenderableType]:
    """A table of several, under its title; nothing where it has no rows."""
    return [Text(title, style="bold"), table, Text()] if table.row_count else []


def figure_rows(figures: Figures, rows: Iterable[tuple[str, tuple[str, ...], str]]) -> list[tuple[str, str]]:
    """Figures that there are, in words. rows: what each is, its dotted keys, and their pattern."""
    found = ((label, [_look_up(figures, key) for key in keys], pattern) for label, keys, pattern in rows)
    return [(label, pattern.format(*values)) for label, values, pattern in found if None not in values]


def event_rows(figures: Figures) -> list[tuple[str, str]]:
    """What happened, and how often."""
    return [("event", f"{name} x {count}") for name, count in figures["events"].items()]


def _look_up(figures: Figures, dotted: str) -> Any:
    value: Any = figures
    for key in dotted.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value


def force_words(force_n: float, sigma_n: float | None) -> str:
    """A force with its standard deviation, where that is known, to its first digit."""
    if sigma_n is None or not math.isfinite(sigma_n):
        return f"{force_n:.4f} N"
    digits = 4 if sigma_n <= 0 else min(max(4, math.ceil(-math.log10(sigma_n))), 7)
    return f"{force_n:.{digits}f} ± {sigma_n:.{digits}f} N"


def _contact_rows(label: str, contacts: Sequence[Figures] | None) -> list[tuple[str, str]]:
    rows = []
    for one in contacts or ():
        sigma = f" ± {one['sigma_area_mm2']:.3f}" if "sigma_area_mm2" in one else ""
        words = f"{one['area_mm2']:.3f}{sigma} mm² at ({one['x_mm']:.3f}, {one['y_mm']:.3f}) mm"
        depth = one.get("depth_mm")
        inside = "" if depth is None else f", {depth:.5f} ± {one['sigma_depth_mm']:.5f} mm deep"
        how_hard, off = one.get("force_n"), one.get("sigma_force_n")
        force = "" if how_hard is None else f", {force_words(how_hard, off)}"
        rows.append((f"{label} {one['id']}", words + inside + force))
    return rows


_STATUS = (
    ("share in contact", "share", "{:.3f} ± {:.3f}"),
    ("spots per cm²", "spots_per_cm2", "{:.0f} ± {:.0f}"),
    ("spot size", "spot_mm2", "{:.4f} ± {:.4f} mm²"),
    ("spot life", "spot_life_s", "{:.2f} ± {:.2f} s"),
    ("sliding", "speed_mm_s", "{:.2f} ± {:.2f} mm/s"),
    ("direction of sliding", "direction_deg", "{:.1f} ± {:.1f}°"),
    ("pitch", "pitch_mm", "{:.3f} ± {:.3f} mm"),
    ("across the ridges", "ridge_deg", "{:.1f} ± {:.1f}°"),
)


def status_rows(status: Figures | None) -> list[tuple[str, str]]:
    """How a texture rubbed, as rows of a table."""
    if status is None:
        return []
    rows = [
        (label, pattern.format(status[name], status[f"sigma_{name}"]))
        for label, name, pattern in _STATUS
        if status[name] is not None
    ]
    if status["aliased"]:
        rows.append(("aliased", f"{100 * status['aliased']:.0f} % of the frames that slip"))
    if status["reason"]:
        rows.append(("not known", status["reason"]))
    return [*rows, *((name, f"at {time_s:.2f} s") for time_s, name in status["events"])]


def _place(one: Figures, to: str = "") -> str:
    """Where something is, or `to_` where it went, in mm."""
    x, y = (f"{one[f'{to}{k}_mm']:.2f} ± {one[f'{to}sigma_{k}_mm']:.2f}" for k in "xy")
    return f"({x}, {y}) mm"


def approach_words(figures: Figures) -> list[tuple[str, str]]:
    """What came, as rows of a table."""
    rows = []
    for one in figures["approaches"]:
        when = f"touch expected at {one['contact_s']:.3f} ± {one['sigma_contact_s']:.3f} s"
        how = f"{one['diameter_mm']:.1f} ± {one['sigma_diameter_mm']:.1f} mm wide"
        fast = f"{one['speed_mm_s']:.1f} ± {one['sigma_speed_mm_s']:.1f} mm/s"
        rows.append(("approach", f"armed at {one['armed_s']:.2f} s, {when}, {_place(one)}, {how}, {fast}"))
    return rows


def pointer_words(figures: Figures) -> list[tuple[str, str]]:
    """What fingers did on an interactive surface, as rows of a table; nothing on any other."""
    if figures["pointers"] is None:
        return []
    rows = [] if figures["pointers"] else [("pointer events", "none")]
    for one in figures["pointers"]:
        words = f"down at {one['down_s']:.2f} s, {_place(one)}; {one['moves']} moves"
        if one["ended"] is None:
            words += f"; still down at {_place(one, 'to_')}"
        else:
            why = "up" if not one["reason"] else f"cancelled ({one['reason']})"
            words += f"; {why} at {one['up_s']:.2f} s, {_place(one, 'to_')}"
        rows.append((f"pointer {one['id']}", f"{words}; pressure up to {one['pressure']:.2f}"))
    return rows


def summary_table(figures: Figures) -> Table:
    """Table of the figures of a run that were measured; rows without a value are left out."""
    rows: list[tuple[str, str]] = []
    named = _PASSIVE if figures["controller"] == "passive" else {}
    of = "the hold" if figures["figures_of"] == "hold" else "the run"
    if (until_s := figures["read_until_s"]) is not None:
        of = f"the run until {until_s:.2f} s"
        rows.append(("not nulled", f"from {until_s:.2f} s to the end: figures and peak are from before"))
    for label, words in figure_rows(figures, _ROWS):
        if not (label == _DEEPEST and words == rows[-1][1]):
            rows.append((named.get(label, label).replace("the hold", of), words))
    rows += approach_words(figures)
    rows += pointer_words(figures)
    rows += _contact_rows("contact", figures.get("contacts"))
    if figures.get("contacts") and figures["force"]["reason"]:
        rows.append(("force", f"not read: {figures['force']['reason']}"))
    rows += status_rows(figures.get("contact_status"))
    rows += _contact_rows("true contact", _look_up(figures, "truth.contacts"))
    if not figures["calibrated"]:
        rows.append(("not calibrated", "depth is relative: zeromethod calibrate"))
    if figures["recording_trouble"]:
        rows.append(("not recorded", figures["recording_trouble"]))
    return pair_table([*rows, *event_rows(figures)])
