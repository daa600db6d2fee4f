"""How much of a recording is not what was written: counted array by array, in one pass over the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Mask
from zeromethod.errors import InputError
from zeromethod.recording.source import Source
from zeromethod.recording.sums import sum_of
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
"""What one item of a group is called, and several."""


def damaged_items(source: Source, lengths: Mapping[str, int], advance: Callable[[], None]) -> dict[str, int]:
    """By group, how many items have an array that is not what was written; groups without any are left out.

    lengths: items of every group that are complete. advance: called after each of `KINDS`, there or not.
    """
    found = {}
    for group in KINDS:
        damaged = _damaged_in(source, group, lengths.get(group, 0))
        if damaged:
            found[group] = damaged
        advance()
    return found


def _damaged_in(source: Source, group: str, length: int) -> int:
    try:
        sums = source.sums(group)
    except InputError:
        # nothing in it can be told from what was written
        return length
    sums = None if sums is None else sums[:length]
    damaged = np.zeros(length, np.bool_)
    arrays = []
    for name in source.summed(group):
        if source.is_table(f"{group}/{name}"):
            told = sums[name] if sums is not None and name in (sums.dtype.names or ()) else None
            damaged |= _damaged_rows(source, f"{group}/{name}", told)
        else:
            arrays.append(name)
    for index in range(length):
        item = None if sums is None else sums[index]
        if not damaged[index]:
            damaged[index] = any(not source.is_sound(group, name, index, item) for name in arrays)
    return int(np.count_nonzero(damaged))


def _damaged_rows(source: Source, name: str, sums: NDArray[np.uint64] | None) -> Mask | bool:
    """(items,) whose row is not what was written; many rows share a chunk, which is read once."""
    try:
        rows = source.table(name)
    except InputError:
        return True
    if sums is None:
        return False
    return np.array([sum_of(row) != int(told) for row, told in zip(rows, sums, strict=False)], np.bool_)


def damaged_words(damaged: Mapping[str, int]) -> str:
    """What `damaged_items` found, as in "damaged: 2 frames, 1 surface left out"; "" for nothing."""
    counts = [f"{count} {KINDS[group][count != 1]}" for group, count in damaged.items()]
    return f"damaged: {', '.join(counts)} left out" if counts else ""


def unknown_surface(shape: tuple[int, int], time_ns: int) -> Surface:
    """In place of a surface that is damaged: no node is valid. shape: (rows, cols) nodes."""
    one, two, none = np.full(shape, np.nan), np.full((*shape, 2), np.nan), np.zeros(shape, np.bool_)
    anchor = Anchor("none", none, np.nan, np.nan)
    return Surface(one, two, one, one, one, two, none, none, anchor, time_ns, 0)
