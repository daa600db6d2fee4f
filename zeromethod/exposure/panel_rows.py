"""Tables by panel row, in scan-out order, read where nodes look."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float


def places(panel_rows: Float, rows: int, entries: int, upwards: bool) -> Float:
    """Where LCD rows (...) of a panel lie among a table's entries, 0..entries - 1.

    upwards: the panel is scanned from its last row on. Rows beyond it count as its edge, NaN as row 0.
    """
    last = entries - 1
    place = np.fmin(np.fmax(panel_rows * (last / (rows - 1)), 0.0), last)
    return np.asarray(last - place if upwards else place)


def at_rows(table: Float, place: Float) -> Float:
    """(..., m) of a table (n, m) at places (...), 0..n - 1, linear between entries."""
    before = np.minimum(place.astype(np.intp), len(table) - 2)
    start, change = table[:-1], np.diff(table, axis=0)
    return np.asarray(start[before] + (place - before)[..., None] * change[before])
