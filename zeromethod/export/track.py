"""The peak's track: one line per step of the loop, as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.export.selection import SelectedSteps
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig

COLUMNS = (
    *("time_s", "depth_mm", "depth_sigma_mm", "x_mm", "y_mm", "x_sigma_mm", "y_sigma_mm"),
    *("total_force_n", "sigma_total_force_n", "state", "where", "damaged"),
)
_NUMBERS = COLUMNS[1:-3]

FINE_COLUMNS = ("time_s", "depth_mm", "depth_sigma_mm", "x_mm", "y_mm", "frames", "valid_share", "state")


def export_track(
    recording: Recording,
    selected: SelectedSteps,
    path: Path,
    advance: Callable[[], None],
    *,
    fine: bool = False,
) -> dict[str, Any]:
    """Write the peak of every moment, empty where nothing was read; "peak" under `damaged`: it is not whole.

    fine: of the fine surfaces, a line for each of them. Returns what was written: lines, and those with a
    peak.
    """
    if fine:
        return _fine_track(recording, selected, path, advance)
    damaged = recording.tables.damaged_steps("peaks")
    peaks = {int(row["step"]): row for row in recording.peaks if np.isfinite(row["depth_mm"])}
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(COLUMNS)
        for step, time_s, state in zip(selected.steps, selected.time_s, selected.states, strict=True):
            row = None if int(step) in damaged else peaks.get(int(step))
            values = [math.nan if row is None else float(row[name]) for name in _NUMBERS]
            # shortest text that gives the same number back
            numbers = [repr(value) if math.isfinite(value) else "" for value in values]
            where = "" if row is None else str(row["where"])
            lines.writerow([f"{time_s:.9f}", *numbers, state, where, "peak" if int(step) in damaged else ""])
            advance()
    return {"times": len(selected.steps), "peaks": len(peaks.keys() & set(selected.steps.tolist()))}


def export_rows(
    recording: Recording,
    selected: SelectedSteps,
    path: Path,
    advance: Callable[[], None],
    *,
    table: str,
    has: Callable[[Rig], bool],
    without: str,
) -> dict[str, Any]:
    """Write all rows of one of `LATER`'s tables, empty where a figure is not known.

    has: whether runs of a rig have such rows. without: what it is recorded without if not, in words.
    """
    if not has(recording.rig):
        raise InputError(f"{recording.path}: recorded {without}")
    rows = recording.tables.later(table)
    rows = rows[np.isin(rows["step"], selected.steps)]
    names = [name for name in rows.dtype.names or () if name not in ("step", "time_ns")]
    time_s = 1e-9 * (rows["time_ns"] - recording.turns["time_ns"][0])
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["time_s", *names])
        for row, at_s in zip(rows, time_s, strict=True):
            lines.writerow([f"{at_s:.9f}", *(_cell(row[name].item()) for name in names)])
    for _ in selected.steps:
        advance()
    return {"rows": len(rows)}


def _cell(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode()
    return "" if isinstance(value, float) and not math.isfinite(value) else repr(value)


def _fine_track(
    recording: Recording, selected: SelectedSteps, path: Path, advance: Callable[[], None]
) -> dict[str, Any]:
    peaks = {int(row["step"]): row for row in recording.fine_peaks}
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(FINE_COLUMNS)
        for step, time_s, state in zip(selected.steps, selected.time_s, selected.states, strict=True):
            values = [peaks[int(step)][name].item() for name in FINE_COLUMNS[1:-1]]
            lines.writerow([f"{time_s:.9f}", *map(repr, values), state])
            advance()
    return {"times": len(selected.steps), "peaks": len(selected.steps)}
