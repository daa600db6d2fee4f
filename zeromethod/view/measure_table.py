"""The figures of measured still images as one table."""

from __future__ import annotations

from typing import Any

from rich.table import Table

_COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("valid", "valid_share", "{:.1%}"),
    ("median shift, px", "displacement_median_px", "{:.3f}"),
    ("largest, px", "displacement_largest_px", "{:.3f}"),
    ("sigma, px", "sigma_median_px", "{:.4f}"),
    ("peak depth, mm", "depth_peak_mm", "{:.5f}"),
    ("its sigma, mm", "depth_peak_sigma_mm", "{:.5f}"),
)


def measure_table(images: list[dict[str, Any]]) -> Table:
    """One row per image; depth only where a rig was given."""
    table = Table(box=None, pad_edge=False)
    table.add_column("image")
    columns = [column for column in _COLUMNS if any(column[1] in image for image in images)]
    for title, _, _ in columns:
        table.add_column(title, justify="right")
    for image in images:
        table.add_row(image["name"], *(pattern.format(image[key]) for _, key, pattern in columns))
    return table
