"""The table of peaks: the deepest point of every surface that was read, with its time and state."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Image, Ints
from zeromethod.recording.schema import STATES
from zeromethod.surface import Where

_FIGURES = (
    *("depth_mm", "depth_sigma_mm", "possibly_deeper_mm"),
    *("x_mm", "y_mm", "x_sigma_mm", "y_sigma_mm", "read_ms"),
)

PEAKS = np.dtype(
    [
        ("step", "i8"),
        ("time_s", "f8"),
        ("state", "U16"),
        *((name, "f8") for name in _FIGURES),
        ("time_ns", "i8"),
        ("where", "U16"),
        ("total_force_n", "f8"),
        ("sigma_total_force_n", "f8"),
    ]
)
"""Columns of `Recording.peaks`."""


def peak_table(rows: Image, start_ns: Ints) -> Image:
    """Table of peaks from its stored rows; times count from `start_ns` (1,), states are words."""
    peaks = np.empty(len(rows), PEAKS)
    for name in ("step", "time_ns", *_FIGURES):
        peaks[name] = rows[name]
    if len(rows):
        peaks["time_s"] = 1e-9 * (rows["time_ns"] - start_ns)
    # files of this format made before there were contacts, and before forces, have no such columns
    known = rows.dtype.names or ()
    peaks["where"] = np.strings.decode(rows["where"]) if "where" in known else Where.MEASURED
    for name in ("total_force_n", "sigma_total_force_n"):
        peaks[name] = rows[name] if name in known else np.nan
    peaks["state"] = np.array([state.value for state in STATES])[rows["state"]]
    return peaks
