"""A replayed session next to the recorded one, as tables."""

from __future__ import annotations

from rich.table import Table

from zeromethod.view.table import Figures, cell, text_table

_SESSIONS = (
    ("frames", "frames", "{}"),
    ("frames nulled", "nulled_share", "{:.1%}"),
    ("residual, camera px rms", "residual_rms_px", "{:.4f}"),
    ("  of nulled frames", "residual_nulled_px", "{:.4f}"),
    ("picture behind the mirror, ms", "lag_ms", "{:+z.1f}"),
    ("largest peak read, mm", "depth_peak_mm", "{:.5f}"),
    ("depth error, µm rms", "depth_error_um", "{:.3f}"),
    ("  of nulled frames", "depth_nulled_error_um", "{:.3f}"),
    ("  worst peak of these, %", "peak_error_percent", "{:+z.3f}"),
)
_DIFFERENCES = (
    ("depth, nm", "depth_difference_nm"),
    ("peak depth, nm", "peak_difference_nm"),
    ("fine depth, nm", "fine_depth_difference_nm"),
    ("fine peak depth, nm", "fine_peak_difference_nm"),
    ("measured warp, LCD px", "measured_difference_lcd_px"),
    ("commanded warp, LCD px", "commanded_difference_lcd_px"),
    ("residual, camera px", "residual_difference_px"),
)
_PAIRS = (
    ("residual, camera px rms", "residual_rms_px", "{:.4f}"),
    ("sigma of a warp, LCD px", "sigma_lcd_px", "{:.4f}"),
    ("valid nodes", "valid_share", "{:.1%}"),
    ("nodes with a depth", "read_share", "{:.1%}"),
)


def sessions_table(sessions: dict[str, Figures]) -> Table:
    """One column per session, by name, as `zeromethod.session.replay.comparison.figures_of` gives them."""
    found = list(sessions.values())
    rows = [(label, [one[key] for one in found], pattern) for label, key, pattern in _SESSIONS]
    rows += [
        (f"motion left at {band} Hz", [one["left_by_hz"].get(band) for one in found], "{:.1%}")
        for band in found[0]["left_by_hz"]
    ]
    return text_table(
        ("", *sessions),
        (
            (label, *(cell(value, pattern) for value in values))
            for label, values, pattern in rows
            if any(value is not None for value in values)
        ),
    )


def differences_table(figures: Figures) -> Table:
    """How far reading or sensing again differs from the recording.

    figures: as those of `DepthDifferences`, `WarpDifferences` and `FineDifferences` of
    `zeromethod.session.replay`.
    """
    rows = [
        (f"{name.replace('_', ' ')}, equal bit for bit", str(figures[name]), str(figures[f"{name}_equal"]))
        for name in ("steps", "readings", "fine_readings")
        if name in figures
    ]
    rows += [
        (f"left out as damaged: {name.replace('_', ' ')}", str(figures[f"{name}_damaged"]), "")
        for name in ("readings", "surfaces", "warps", "fine_surfaces")
        if figures.get(f"{name}_damaged")
    ]
    if figures.get("fine_readings_unread"):
        rows.append(("fine readings without all of their frames", str(figures["fine_readings_unread"]), ""))
    for label, key, pattern in _PAIRS:
        if (pair := figures.get(key)) is not None:
            rows.append((label, cell(pair["recorded"], pattern), cell(pair["replayed"], pattern)))
    rows.append(("[bold]difference[/bold]", "rms", "largest"))
    for label, key in _DIFFERENCES:
        found = figures.get(key)
        if found is not None and found["rms"] is not None:
            rows.append((label, f"{found['rms']:.3g}", f"{found['largest']:.3g}"))
    return text_table(("", "recorded", "again"), rows)
