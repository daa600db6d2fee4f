"""What is in a recording: every dataset with its type, units and meaning.

Datasets grow along their first axis, one item at a time. In a group with a dataset `step`, item i of every
dataset belongs to step `step[i]` of the loop. `step` grows last, so that a reader that follows the file finds
the others at least as long.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.checksums import CHECKSUMS
from zeromethod.recording.columns import FINE_READINGS, READINGS, TABLES, Fields, row_dtype
from zeromethod.warp.grid import PADDING

SCHEMA = "zeromethod recording"
SCHEMA_VERSION = 3

LIGHT_ARRAYS = "zeromethod light arrays"
"""Format of recordings of LED and photodetector arrays, which have a layout of their own."""

KEEP = ("frames", "residual", "warps", "surface", "fine")
"""What may be kept or left out; tables are always kept. "fine": of a run that reads every pixel."""

STATES = tuple(State)
EVENTS = tuple(Event)
AnchorMode = Literal["none", "known", "quiet", "loads"]
ANCHORS: tuple[AnchorMode, ...] = ("none", "known", "quiet", "loads")


@dataclass(frozen=True)
class Dataset:
    """One dataset. dtype, shape: of an item. units, meaning: its attributes; of a table, those of `fields`.

    kept: which of `KEEP` it goes with, "" where it is always there.
    """

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    units: str
    meaning: str
    kept: str = ""
    fields: Fields | None = None

    @property
    def bytes(self) -> int:
        """Size of an item."""
        return int(np.prod(self.shape, dtype=int)) * self.dtype.itemsize


_WHY = "why a node is not to be trusted: bits named in the attribute `flags`; 0 = valid"
_LCD = "(column, row) on the LCD per camera node; pixel centres at integers"

_SURFACE = (
    ("depth_mm", "f4", "nodes", "mm", "depth at the node's mirror point, positive into the rubber"),
    ("slope", "f4", "pairs", "rad", "(d depth/dx, d depth/dy)"),
    ("x_mm", "f4", "nodes", "mm", "mirror point, world x"),
    ("y_mm", "f4", "nodes", "mm", "mirror point, world y"),
    ("sigma_depth_mm", "f4", "nodes", "mm", "standard deviation of depth"),
    ("sigma_slope", "f4", "pairs", "rad", "standard deviation of slope"),
    ("valid", "?", "nodes", "", "nodes with a depth"),
    ("contact", "?", "nodes", "", "light lost: total reflection fails, or contact"),
    ("anchor", "?", "nodes", "", "nodes where depth was taken as known"),
)

ARRAYS = (
    ("zeros/q", "f8", "pairs", "LCD px", "zero less the warp at rest: warp from rest = measured + zero"),
    ("frames/image", "u1", "image", "grey levels", "frame as the camera gave it"),
    ("residual/d", "f4", "pairs", "camera px", "(u, v): what is observed at a node is shown at node + d"),
    ("residual/sigma", "f4", "pairs", "camera px", "standard deviation of d"),
    ("residual/flags", "u2", "nodes", "", _WHY),
    ("residual/mean", "f4", "nodes", "grey levels", "mean grey around the node, black level included"),
    ("warps/measured/q", "f8", "pairs", "LCD px", f"warp by this frame alone, from the last zero: {_LCD}"),
    ("warps/measured/sigma", "f8", "pairs", "LCD px", "standard deviation of q"),
    ("warps/measured/flags", "u2", "nodes", "", _WHY),
    ("warps/commanded/q", "f4", "pairs", "LCD px", f"warp to be shown next: {_LCD}"),
    ("warps/shown/q", "f4", "pairs", "LCD px", f"mix of warps lit in the exposure: {_LCD}"),
    *((f"surface/{name}", *rest) for name, *rest in _SURFACE),
    ("fine/depth_mm", "f4", "pixels", "mm", "depth on every camera pixel; NaN where it was not read"),
    ("fine/slope", "f4", "pixel pairs", "rad", "(d depth/dx, d depth/dy)"),
    ("fine/sigma_depth_mm", "f4", "pixels", "mm", "standard deviation of depth as seen through the pupil"),
    ("fine/sigma_slope", "f4", "pixel pairs", "rad", "standard deviation of slope"),
    ("fine/x_mm", "f4", "lattice", "mm", "mirror point, world x, of the pixels on nodes; smooth in between"),
    ("fine/y_mm", "f4", "lattice", "mm", "mirror point, world y, likewise"),
    ("fine/share", "f4", "lattice", "", "1: read pixel by pixel; 0: interpolated, as the mirror moved"),
    *((f"fine_nodes/{name}", *rest) for name, *rest in _SURFACE),
    ("pictures/q", "f8", "pairs", "LCD px", f"warp that was drawn: {_LCD}"),
)
"""Every array: group/name, type, shape of an item, units, meaning."""

_KEPT = {"zeros": "", "pictures": "warps", "fine_nodes": "fine"}
"""Of `KEEP` what a group goes with, where that is not how its name begins."""

CHECKSUM_MEANING = (
    "finds damage: of item i of each dataset here its size in bytes plus its bytes as little-endian 64-bit "
    "words, modulo 2**64"
)


def parts(
    image_shape: tuple[int, int],
    bits: int,
    grid_shape: tuple[int, int],
    keep: Collection[str] = KEEP,
    every: int = 1,
    fine_shape: tuple[int, int] | None = None,
) -> dict[str, Dataset]:
    """Datasets that grow, by name. image_shape: (rows, cols) px. grid_shape: (rows, cols) nodes.

    fine_shape: pixels (rows, cols) of fine surfaces; None: the run reads none.

    The warps of all pictures are kept only where every frame is: only then can frames be processed again.
    """
    shapes = {"image": image_shape, "nodes": grid_shape, "pairs": (*grid_shape, 2)}
    if fine_shape is not None:
        lattice = grid_shape[0] - 2 * PADDING, grid_shape[1] - 2 * PADDING
        shapes |= {"pixels": fine_shape, "pixel pairs": (*fine_shape, 2), "lattice": lattice}
    groups: dict[str, list[Dataset]] = {}
    for name, kind, shape, units, meaning in ARRAYS:
        group = name.rpartition("/")[0]
        kept = _KEPT.get(group, group.partition("/")[0])
        left_out = kept == "fine" and fine_shape is None
        if left_out or (kept and kept not in keep) or (group == "pictures" and every != 1):
            continue
        number = Dataset(number_name(group), np.dtype("i8"), (), "", _NUMBERS.get(group, _OF_STEP), kept)
        dtype = np.dtype("u2" if shape == "image" and bits > 8 else kind)
        own = groups.setdefault(group, [number])
        own.append(Dataset(name, dtype, shapes[shape], units, meaning, kept))
    found: list[Dataset] = []
    for name, (fields, meaning) in TABLES.items():
        table = _table(name, fields, meaning)
        found += [table, _checksums(name, [table])]
    for group, own in groups.items():
        kept = own[0].kept
        if group in {"surface", "fine_nodes"}:
            own.append(_table(group, READINGS, "what a reading is anchored to", kept))
        if group == "fine":
            own.append(_table(group, FINE_READINGS, "how it was read", kept))
        found += [*own, _checksums(group, own, kept)]
    return {part.name: part for part in found}


_OF_STEP = "step of the loop that item i of this group belongs to"
_NUMBERS = {
    "zeros": "first step that is measured from this zero",
    "pictures": "row of presentation_log/table whose picture item i of this group is",
}


def _table(group: str, fields: Fields, meaning: str, kept: str = "", name: str = "table") -> Dataset:
    return Dataset(
        f"{group}/{name}", row_dtype(fields), (), "see the attribute `fields`", meaning, kept, fields
    )


def _checksums(group: str, own: Collection[Dataset], kept: str = "") -> Dataset:
    """Dataset with the checksums of a group's others."""
    fields = {part.name.rpartition("/")[2]: ("u8", "", f"checksum of {part.name}") for part in own}
    return _table(group, fields, CHECKSUM_MEANING, kept, CHECKSUMS)


def number_name(group: str) -> str:
    """Dataset that numbers a group's items: `step`; `row` of presentation_log/table for pictures."""
    return f"{group}/row" if group == "pictures" else f"{group}/step"
