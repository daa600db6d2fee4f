"""A replayed session beside the recorded one, as tables of plain words."""

from __future__ import annotations

from typing import Any

from rich.table import Table

Figures = dict[str, Any]

_SESSIONS: tuple[tuple[str, str, str], ...] = (
    ("frames", "frames", "{}"),
    ("frames nulled", "nulled_share", "{:.1%}"),
    ("residual, camera px rms", "residual_rms_px", "{:.4f}"),
    ("  of nulled frames", "residual_nulled_px", "{:.4f}"),
    ("picture behind the mirror, ms", "lag_ms", "{:+.1f}"),
    ("largest peak read, mm", "depth_peak_mm", "{:.5f}"),
    ("depth error, um rms", "depth_error_um", "{:.3f}"),
    ("  of nulled frames", "depth_nulled_error_um", "{:.3f}"),
    ("  worst peak of these, %", "peak_error_percent", "{:+.3f}"),
)

_DIFFERENCES: tuple[tuple[str, str], ...] = (
    ("depth, nm", "depth_difference_nm"),
    ("peak depth, nm", "peak_difference_nm"),
    ("measured warp, LCD px", "measured_difference_lcd_px"),
    ("commanded warp, LCD px", "commanded_difference_lcd_px"),
    ("residual, camera px", "residual_difference_px"),
)

_PAIRS: tuple[tuple[str, str, str], ...] = (
    ("residual, camera px rms", "residual_rms_px", "{:.4f}"),
    ("sigma of a warp, LCD px", "sigma_lcd_px", "{:.4f}"),
    ("valid nodes", "valid_share", "{:.1%}"),
    ("nodes with a depth", "read_share", "{:.1%}"),
)


_DAMAGED: tuple[tuple[str, str], ...] = (
    ("readings", "readings_damaged"),
    ("surfaces", "surfaces_damaged"),
    ("warps", "warps_damaged"),
)


def _cell(pattern: str, value: Any) -> str:
    return "-" if value is None else pattern.format(value)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def sessions_table(sessions: dict[str, Figures]) -> Table:
    """One column per session: recorded, simulated, changed.

    sessions: by name, as `zeromethod.session.replay.comparison.figures_of` gives them.
    """
    table = Table(box=None, pad_edge=False)
    table.add_column(style="dim")
    for name in sessions:
        table.add_column(name, justify="right")
    for label, key, pattern in _SESSIONS:
        values = [figures[key] for figures in sessions.values()]
        if any(value is not None for value in values):
            table.add_row(label, *(_cell(pattern, value) for value in values))
    bands = next(iter(sessions.values()))["left_by_hz"]
    for band in bands:
        values = [figures["left_by_hz"].get(band) for figures in sessions.values()]
        if any(value is not None for value in values):
            table.add_row(
                f"motion left at {band} Hz, %", *(_cell("{:.1f}", _percent(value)) for value in values)
            )
    return table


def differences_table(figures: Figures) -> Table:
    """What reading or sensing again came to.

    figures: as `DepthDifferences.figures` and `WarpDifferences.figures` of `zeromethod.session.replay`.
    """
    table = Table(box=None, pad_edge=False)
    table.add_column(style="dim")
    for name in ("recorded", "replayed"):
        table.add_column(name, justify="right")
    for name in ("steps", "readings"):
        if name in figures:
            table.add_row(f"{name}, equal bit for bit", str(figures[name]), str(figures[f"{name}_equal"]))
    for name, key in _DAMAGED:
        if figures.get(key):
            table.add_row(f"left out as damaged: {name}", str(figures[key]))
    for label, key, pattern in _PAIRS:
        if figures.get(key) is not None:
            pair = figures[key]
            table.add_row(label, _cell(pattern, pair["recorded"]), _cell(pattern, pair["replayed"]))
    table.add_section()
    table.add_row("[bold]difference[/bold]", "rms", "largest")
    for label, key in _DIFFERENCES:
        found = figures.get(key)
        if found is not None and found["rms"] is not None:
            table.add_row(label, f"{found['rms']:.3g}", f"{found['largest']:.3g}")
    return table
