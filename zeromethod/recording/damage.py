"""How much of a recording is damaged: counted array by array and row by row, in one pass over the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from zeromethod.arrays import Ints
from zeromethod.errors import InputError
from zeromethod.recording.checksums import checksums_of
from zeromethod.recording.source import RecordingFile
from zeromethod.surface import Anchor, Surface

if TYPE_CHECKING:
    from zeromethod.recording.recording import Recording

KINDS = {
    "frames": ("frame", "frames"),
    "residual": ("residual", "residuals"),
    "warps/measured": ("measured warp", "measured warps"),
    "warps/commanded": ("commanded warp", "commanded warps"),
    "warps/shown": ("shown warp", "shown warps"),
    "surface": ("surface", "surfaces"),
    "fine": ("fine surface", "fine surfaces"),
    "fine_nodes": ("fine surface's nodes", "fine surfaces' nodes"),
    "pictures": ("picture's warp", "pictures' warps"),
    "zeros": ("zero", "zeros"),
    "rest": ("array of the mirror at rest", "arrays of the mirror at rest"),
    "files": ("file that the rig names", "files that the rig names"),
    "steps": ("step's row", "steps' rows"),
    "peaks": ("peak", "peaks"),
    "fine_peaks": ("fine surface's peak", "fine surfaces' peaks"),
    "presentation_log": ("row of the presentation log", "rows of the presentation log"),
    "drops": ("drop's row", "drops' rows"),
    "notes": ("note", "notes"),
    "approaches": ("row of what comes", "rows of what comes"),
    "contact_status": ("contact status's row", "contact status's rows"),
    "pointers": ("pointer event's row", "pointer events' rows"),
    "calls": ("call's row", "calls' rows"),
}
"""Words for one item of a group, and for several; the last ten are tables, two before them fixed."""


_ROUGH, _SIGMAS = 0.5, 5.0
"""How much a peak and the nodes around it may differ: share of the depth, and standard deviations."""


def damaged_items(
    source: RecordingFile, lengths: Mapping[str, int], advance: Callable[[], None]
) -> dict[str, int]:
    """Number of items with a damaged array, by group; groups without any are left out.

    lengths: complete items of every group. advance: called after each of `KINDS`, there or not.
    """
    found = {}
    for group in KINDS:
        fixed = group in {"rest", "files"}
        damaged = (
            sum(not source.is_whole(f"{group}/{name}") for name in source.summed(group))
            if fixed
            else _damaged_in(source, group, lengths.get(group, 0))
        )
        if damaged:
            found[group] = damaged
        advance()
    return found


def _damaged_in(source: RecordingFile, group: str, length: int) -> int:
    damaged = np.zeros(length, np.bool_)
    arrays = []
    try:
        checksums = source.checksums(group)
        checksums = None if checksums is None else checksums[:length]
        for name in source.summed(group):
            if not source.is_table(f"{group}/{name}"):
                arrays.append(name)
            elif checksums is not None and name in (checksums.dtype.names or ()):
                # many rows share a chunk, which is read once
                damaged |= checksums_of(source.table(f"{group}/{name}")[:length]) != checksums[name]
    except InputError:
        return length
    for index in np.flatnonzero(~damaged).tolist() if arrays else ():
        item = None if checksums is None else checksums[index]
        damaged[index] = any(not source.is_sound(group, name, index, item) for name in arrays)
    return int(np.count_nonzero(damaged))


def damaged_words(damaged: Mapping[str, int]) -> str:
    """Sentence of what `damaged_items` found: "damaged: 2 frames, 1 surface left out"; "" for nothing."""
    counts = [f"{count} {KINDS[group][count != 1]}" for group, count in damaged.items()]
    return f"damaged: {', '.join(counts)} left out" if counts else ""


def contrary_peaks(recording: Recording, among: Ints | None = None) -> set[int]:
    """Steps whose peak contradicts its sound surface. among: steps that are looked at; None: all."""
    peaks, kept = recording.peaks, recording.steps_with("surface")
    asked = kept if among is None else np.intersect1d(kept, among)
    found = set()
    for peak in peaks[np.isin(peaks["step"], asked)]:
        step = int(peak["step"])
        surface = recording.surface(step)
        if surface is not None and not fits_surface(peak, surface):
            found.add(step)
    return found


def fits_surface(peak: Any, surface: Surface) -> bool:
    """Whether a row of `peaks` can be the peak of its surface; made to find what is wrong, not what is rough.

    A fit between the nodes differs from them by less than half where a dent is hardly wider than a node, and
    goes deeper than all where a fold cuts nodes off; it is never much shallower than the deepest of them.
    """
    depth_mm, margin_mm = abs(float(peak["depth_mm"])), _SIGMAS * float(peak["depth_sigma_mm"])
    if not surface.valid.any():
        # damaged, or nothing was read
        return True
    if int(peak["time_ns"]) != surface.time_ns:
        return False
    deepest_mm = float(np.max(np.abs(surface.depth_mm), where=surface.valid, initial=0.0))
    if not np.isfinite(depth_mm) or depth_mm + margin_mm < (1.0 - _ROUGH) * deepest_mm:
        return False
    away = np.hypot(surface.x_mm - peak["x_mm"], surface.y_mm - peak["y_mm"])
    row, column = np.unravel_index(int(np.nanargmin(away)), away.shape)
    if not surface.valid[row, column]:
        return True
    node_mm = float(surface.depth_mm[row, column])
    return abs(float(peak["depth_mm"]) - node_mm) <= _ROUGH * max(depth_mm, abs(node_mm)) + margin_mm


def unknown_surface(shape: tuple[int, int], row: Any) -> Surface:
    """Surface without a valid node, in place of a damaged one. shape: (rows, cols) nodes. row: its step's."""
    one, two, none = np.full(shape, np.nan), np.full((*shape, 2), np.nan), np.zeros(shape, np.bool_)
    anchor = Anchor("none", none, np.nan, np.nan)
    time_ns = 0 if row is None else int(row["time_ns"])
    return Surface(one, two, one, one, one, two, none, none, anchor, time_ns, 0)
