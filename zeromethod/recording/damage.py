"""How much of a recording is damaged: counted array by array, in one pass over the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Mask
from zeromethod.errors import InputError
from zeromethod.recording.checksums import checksum_of
from zeromethod.recording.source import RecordingFile
from zeromethod.surface import Anchor, Surface

KINDS = {
    "frames": ("frame", "frames"),
    "residual": ("residual", "residuals"),
    "warps/measured": ("measured warp", "measured warps"),
    "warps/commanded": ("commanded warp", "commanded warps"),
    "warps/shown": ("shown warp", "shown warps"),
    "surface": ("surface", "surfaces"),
    "pictures": ("picture's warp", "pictures' warps"),
    "zeros": ("zero", "zeros"),
}
"""Words for one item of a group, and for several."""


def damaged_items(
    source: RecordingFile, lengths: Mapping[str, int], advance: Callable[[], None]
) -> dict[str, int]:
    """Number of items with a damaged array, by group; groups without any are left out.

    lengths: complete items of every group. advance: called after each of `KINDS`, there or not.
    """
    found = {}
    for group in KINDS:
        damaged = _damaged_in(source, group, lengths.get(group, 0))
        if damaged:
            found[group] = damaged
        advance()
    return found


def _damaged_in(source: RecordingFile, group: str, length: int) -> int:
    try:
        checksums = source.checksums(group)
    except InputError:
        return length
    checksums = None if checksums is None else checksums[:length]
    damaged = np.zeros(length, np.bool_)
    arrays = []
    for name in source.summed(group):
        if not source.is_table(f"{group}/{name}"):
            arrays.append(name)
        elif checksums is not None and name in (checksums.dtype.names or ()):
            damaged |= _damaged_rows(source, f"{group}/{name}", checksums[name])
    for index in np.flatnonzero(~damaged).tolist():
        item = None if checksums is None else checksums[index]
        damaged[index] = any(not source.is_sound(group, name, index, item) for name in arrays)
    return int(np.count_nonzero(damaged))


def _damaged_rows(source: RecordingFile, name: str, checksums: NDArray[np.uint64]) -> Mask | bool:
    """(items,) whose row does not fit its checksum; many rows share a chunk, which is read once."""
    try:
        rows = source.table(name)
    except InputError:
        return True
    return np.array(
        [checksum_of(row) != int(one) for row, one in zip(rows, checksums, strict=False)], np.bool_
    )


def damaged_words(damaged: Mapping[str, int]) -> str:
    """Sentence of what `damaged_items` found: "damaged: 2 frames, 1 surface left out"; "" for nothing."""
    counts = [f"{count} {KINDS[group][count != 1]}" for group, count in damaged.items()]
    return f"damaged: {', '.join(counts)} left out" if counts else ""


def unknown_surface(shape: tuple[int, int], row: Any) -> Surface:
    """Surface without a valid node, in place of a damaged one. shape: (rows, cols) nodes. row: its step's."""
    one, two, none = np.full(shape, np.nan), np.full((*shape, 2), np.nan), np.zeros(shape, np.bool_)
    anchor = Anchor("none", none, np.nan, np.nan)
    time_ns = 0 if row is None else int(row["time_ns"])
    return Surface(one, two, one, one, one, two, none, none, anchor, time_ns, 0)
