"""The tables of `zeromethod reproduce`: needle, press, and how firm the press's figures are."""

from __future__ import annotations

from rich.table import Table

from zeromethod.view.table import UNKNOWN, Figures, cell, text_table

_COLUMNS = {
    "paper": "paper\n(printed)",
    "whole_pixel_picks": "its method,\nwhole pixels",
    "sub_pixel_picks": "its method,\nsub-pixel",
    "whole_image": "all pixels,\ntwo images",
    "zero_method": "zero\nmethod",
}
_ROWS = (
    ("peak depth, mm", "peak_mm", "{:.5f}"),
    ("peak error, %", "peak_error_percent", "{:+z.3f}"),
    ("line rms, µm", "line_rms_um", "{:.3f}"),
    ("view rms, µm", "view_rms_um", "{:.3f}"),
    ("points read", "points", "{}"),
)
_PRINTED = {"peak_mm": "about 0.2", "peak_error_percent": "about 10"}
_NEEDLE_COLUMNS = {
    "paper": "paper\n(printed)",
    "equation_17_gamma_0": "eq. 17,\ngamma=0",
    "equation_17_gamma_0_lagged_sum": "same,\n19 lags",
    "equation_17_exact_geometry": "eq. 17,\nexact rays",
    "equation_12_exact_geometry": "eq. 12,\nexact rays",
    "zero_method": "this\nsystem",
}
_NEEDLE_ROWS = (
    ("theta error, rad", "theta_max_error_rad", "theta_away_error_rad"),
    ("depth error, px", "depth_max_error_px", "depth_away_error_px"),
)


def needle_table(needle: Figures) -> Table:
    """Section 3.1, a figure from `NeedleResult.figures`; the reading's: one averaging window off the tip."""
    peak_px = needle["needle"]["peak_px"]
    rows = []
    for label, key, away in _NEEDLE_ROWS:
        values = [needle[name][away if name == "zero_method" else key] for name in _NEEDLE_COLUMNS]
        rows.append((label, *(cell(value, "{:.2g}") for value in values)))
    rows.append(("depth error, %", *(cell(100 * value / peak_px, "{:.2g}") for value in values)))
    title = "Section 3.1: needle, 40 px over 1637 px, largest errors (this system: one window off the tip)"
    return text_table(("", *_NEEDLE_COLUMNS.values()), rows, title=title)


def press_table(figures: Figures) -> Table:
    """One press (0.2 mm, sigma 5 mm), one rig; what a column cannot give is a dash."""
    rows = [
        (
            label,
            *(
                _PRINTED.get(key, UNKNOWN)
                if name == "paper"
                else cell(figures["press"][name].get(key), pattern)
                for name in _COLUMNS
            ),
        )
        for label, key, pattern in _ROWS
    ]
    title = "Section 5: the same press, read in four ways"
    return text_table(("", *_COLUMNS.values()), rows, title=title)


def press_notes(figures: Figures) -> list[str]:
    """What the table does not say: how far the picks' error depends on where the press lies, and why."""
    moved, bare = figures["press_moved"], figures["error_percent_without_pick_error"]
    without_lag = figures["press_without_lag"]
    notes = []
    for name, title in (("whole_pixel_picks", "whole pixels"), ("sub_pixel_picks", "sub-pixel")):
        lagged, straight = _spread(moved[name]), _spread(moved[f"{name}_without_lag"])
        notes.append(f"{title}, press moved to {moved[name]['positions']} places: error at the peak {lagged}")
        notes.append(
            f"{title}, equation 19 without its lag of one interval, as in the needle's columns: "
            f"{without_lag[name]['peak_error_percent']:+z.1f} %; moved: {straight}"
        )
    notes.append(
        f"picks without error: {bare['as built']:+.1f} %; without the LCD's air gap {bare['acryl']:+.1f} %, "
        f"without the acryl too {bare['bare']:+.1f} % (the equations know neither)"
    )
    own = figures["whole_image_own_window"]
    percent = cell(own["peak_error_percent"], "{:+z.2f}")
    rms_um = cell(own["view_rms_um"], "{:.2f}")
    notes.append(
        "all pixels: window of 10 px, picked from 6, 8, 10 and 12 px with the truth of this press in sight; "
        f"with windows that the correlation chooses itself: {percent} % at the peak, {rms_um} µm rms"
    )
    return notes


def _spread(errors: Figures) -> str:
    least, most, median = (errors[f"{key}_percent"] for key in ("least", "most", "median"))
    return f"{least:+z.1f} to {most:+z.1f} %, median {median:+z.1f} %"
