"""The summary of a run as a table of plain words."""

from __future__ import annotations

from typing import Any

from rich.table import Table

_ROWS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("state at the end", ("state",), "{}"),
    ("frames (dropped)", ("frames", "dropped"), "{} ({})"),
    ("frames to lock in the hold", ("lock_frames",), "{}"),
    ("residual in the hold", ("residual_px_rms",), "{:.4f} camera px rms"),
    ("nodes that see the LCD by the mirror", ("usable_share",), "{:.1%}"),
    ("of these called valid", ("valid_share",), "{:.1%}"),
    ("peak depth read (sigma)", ("depth_peak_mm", "depth_peak_sigma_mm"), "{:.5f} mm ({:.5f})"),
    ("true peak depth", ("truth.depth_peak_mm",), "{:.5f} mm"),
    ("peak error, worst frame of the hold", ("truth.depth_peak_error_percent",), "{:+.3f} %"),
    ("depth error in the hold", ("truth.depth_rms_error_um",), "{:.4f} um rms"),
    ("slope error in the hold", ("truth.slope_rms_error_mrad",), "{:.4f} mrad rms"),
    ("peak error, worst frame of the slide", ("truth_slide.depth_peak_error_percent",), "{:+.3f} %"),
    ("depth error in the slide", ("truth_slide.depth_rms_error_um",), "{:.4f} um rms"),
    ("depth noise untouched, single frame", ("untouched.depth_rms_nm",), "{:.1f} nm rms"),
    ("depth noise untouched, filtered", ("untouched.depth_filtered_rms_nm",), "{:.1f} nm rms"),
    ("loop, frame in to warp out", ("loop_ms.median", "loop_ms.p99"), "{:.2f} ms (p99 {:.2f})"),
    ("drawing the pattern", ("draw_ms.median", "draw_ms.p99"), "{:.1f} ms (p99 {:.1f})"),
    ("reading the surface", ("read_ms.median", "read_ms.p99"), "{:.1f} ms (p99 {:.1f})"),
    ("delay of display and camera", ("delay_ms",), "{:.2f} ms"),
    ("stability: times the gain until it swings", ("stability_margin",), "{:.2g}"),
    ("refreshes dropped by the display", ("dropped_refreshes",), "{}"),
    ("GL renderer", ("gl_renderer",), "{}"),
)


def _look_up(figures: dict[str, Any], dotted: str) -> Any:
    value: Any = figures
    for key in dotted.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value


def summary_table(figures: dict[str, Any]) -> Table:
    """Table of the figures that were measured; rows without a value are left out."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    for label, keys, pattern in _ROWS:
        values = [_look_up(figures, key) for key in keys]
        if all(value is not None for value in values):
            table.add_row(label, pattern.format(*values))
    if figures["recording"]:
        table.add_row("recording", figures["recording"])
    for name, count in figures["events"].items():
        table.add_row("event", f"{name} x {count}")
    return table
