"""The dated lines that daily checks leave next to the calibration: one table, a line each."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

from zeromethod.calibration.folder import calibration_of, home_of
from zeromethod.commissioning.daily_check.findings import DailyCheck

FILE = "checks.csv"

_FIGURES = (
    *("focus_score", "saturated_share", "usable_share", "flicker_share", "delay_ms", "delay_change_ms"),
    *("rest_drift_lcd_px", "rest_false_depth_um", "rest_false_depth_sigma_um"),
    *("rezeroed_depth_error_percent", "frames", "dropped", "unused"),
    *("press_read_mm", "press_sigma_mm", "press_error_percent", "delay_scatter_ms"),
)
COLUMNS = ("time", "rig", "fitness", "verdict", *_FIGURES)


def log_of(rig_file: str | Path) -> Path:
    """Where the checks of a rig are kept: in its calibration's folder, else where its calibrations go."""
    stored = calibration_of(rig_file)
    return (home_of(rig_file) if stored is None else stored.folder) / FILE


def append_check(path: Path, check: DailyCheck) -> None:
    """Add a line to the table, which is made where there is none. Raises OSError.

    The line goes to the file in one call: a reader, or a second check, never sees half of it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    figures = {name: f"{value:.6g}" for name, value in check.figures.items()}
    row = figures | {
        "time": check.time.isoformat(timespec="seconds"),
        "rig": check.rig,
        "fitness": check.fitness.value,
        "verdict": check.verdict,
    }
    text = io.StringIO()
    columns = _columns_of(path)
    writer = csv.DictWriter(text, columns or COLUMNS, lineterminator="\n", extrasaction="ignore")
    if columns is None:
        writer.writeheader()
    writer.writerow(row)
    with path.open("a", encoding="utf-8") as file:
        file.write(text.getvalue())
        file.flush()
        os.fsync(file.fileno())


def _columns_of(path: Path) -> list[str] | None:
    """Columns of the table, which another version may have begun; None where there is none."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return next(csv.reader(file), None)
    except FileNotFoundError:
        return None
