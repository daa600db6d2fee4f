"""What is in a recording: every dataset with its type, units and meaning.

Datasets grow along their first axis, one item at a time. Those of a group whose first is called `turn` go
together: item i of each belongs to the turn of the loop that `turn[i]` numbers. `turn` grows last, so that
who reads along finds the others at least as long.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.sums import SUMS

SCHEMA = "zeromethod recording"
SCHEMA_VERSION = 1

KEEP = ("frames", "residual", "warps", "surface")
"""What may be kept or left out; the tables always are kept."""

STATES = tuple(State)
EVENTS = tuple(Event)
ANCHORS: tuple[Literal["none", "known", "quiet"], ...] = ("none", "known", "quiet")

Fields = Mapping[str, tuple[str, str, str]]
"""Type, units and meaning of every field of a table."""

Arrays = dict[str, tuple[str, tuple[int, ...], str, str]]
"""Type, shape of an item, units and meaning of every array of a group."""


@dataclass(frozen=True)
class Part:
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

    @property
    def group(self) -> str:
        """Name of the group that it lies in."""
        return self.name.rpartition("/")[0]


TURNS: Fields = {
    "number": ("i8", "", "number of the turn, from 1"),
    "time_ns": ("i8", "ns", "mid-exposure of its frame on the run's clock, else when the turn ended"),
    "exposure_ns": ("i8", "ns", "length of the exposure; 0 without a frame"),
    "frame_number": ("i8", "", "the camera's own count; -1 without a frame"),
    "dropped": ("i4", "frames", "frames that the camera lost since the one before"),
    "state": ("u1", "", "state of the loop after the turn: index in the attribute `states`"),
    "held": ("?", "", "corrections were held by request or paused"),
    "sensed": ("?", "", "the frame was fit to be looked at"),
    "residual_rms_px": ("f8", "camera px", "rms length of the residual over valid nodes"),
    "valid_share": ("f8", "", "valid nodes among those seen at rest"),
    "loop_ms": ("f8", "ms", "from frame in hand to command"),
    "draw_ms": ("f8", "ms", "to draw and present a picture; NaN where none was presented"),
    "delay_ms": ("f8", "ms", "from mid-exposure until the panel's middle row is half-way to the new picture"),
    "events": ("u8", "", "what happened: bit i is entry i of the attribute `events`"),
    "phase": ("S16", "", "part of the simulated scenario; empty where unknown"),
    "reason": ("S160", "", "why the loop is in its state"),
}

PRESENTATIONS: Fields = {
    "after_turn": ("i8", "", "last turn whose frame was looked at before this picture was noted as shown"),
    "time_ns": ("i8", "ns", "when it was given to the panel"),
    "seen_ns": ("i8", "ns", "mid-exposure of the newest frame that it was made from; -1 for none"),
    "code": ("i4", "", "code in its strips; -1 for none"),
    "draw_ms": ("f8", "ms", "to draw and present it"),
}

PEAKS: Fields = {
    "turn": ("i8", "", "turn that the surface was read from"),
    "depth_mm": ("f8", "mm", "depth at the point of largest |depth|, positive into the rubber"),
    "sigma_mm": ("f8", "mm", "its standard deviation"),
    "deeper_mm": ("f8", "mm", "part of it that only goes one way: how much deeper holes may be"),
    "x_mm": ("f8", "mm", "where: world x"),
    "y_mm": ("f8", "mm", "where: world y"),
    "read_ms": ("f8", "ms", "how long reading the surface took"),
}

DROPS: Fields = {
    "turn": ("i8", "", "turn in which frames were found missing, or whose arrays were not kept"),
    "time_ns": ("i8", "ns", "time of that turn"),
    "count": ("i4", "frames", "how many"),
    "what": ("S16", "", "camera: the loop never saw them; recorder: seen by the loop, arrays not kept here"),
    "why": ("S120", "", "why"),
}

NOTES: Fields = {
    "turn": ("i8", "", "turn"),
    "time_ns": ("i8", "ns", "time of that turn"),
    "text": ("S240", "", "what the operator was told"),
}

READINGS: Fields = {
    "time_ns": ("i8", "ns", "mid-exposure of the frame that it was read from"),
    "iterations": ("i4", "", "ray-surface intersections taken until depth settled"),
    "anchor": ("u1", "", "where depth was taken as known: index in the attribute `anchors`"),
    "anchor_sigma_mm": ("f8", "mm", "standard deviation that depth owes to the anchor"),
    "anchor_tail_mm": ("f8", "mm", "depth that the anchor's nodes still have, over the reader's scale"),
}

SUM_MEANING = (
    "by which damage is noticed: of item i of each dataset here its size in bytes plus its bytes as "
    "little-endian 64-bit words, modulo 2**64"
)


def parts(
    image_shape: tuple[int, int],
    bits: int,
    grid_shape: tuple[int, int],
    keep: Collection[str] = KEEP,
    every: int = 1,
) -> dict[str, Part]:
    """Datasets that grow, by name. image_shape: (rows, cols) px. grid_shape: (rows, cols) nodes.

    The warps of all pictures are kept only where every frame is: they serve to look at frames anew.
    """
    nodes, pair = grid_shape, (*grid_shape, 2)
    why = "why a node is not to be trusted: bits named in the attribute `flags`; 0 = valid"
    lcd = "(column, row) on the LCD per camera node; pixel centres at integers"
    image = "u1" if bits == 8 else "u2"
    tables = [
        _table("turns", TURNS, "one row per turn of the loop"),
        _table("presentations", PRESENTATIONS, "one row per picture given to the panel"),
        _table("peaks", PEAKS, "point of largest |depth| of every surface that was read"),
        _table("drops", DROPS, "frames that are not in this file"),
        _table("notes", NOTES, "what the operator was told"),
    ]
    zeros: Arrays = {
        "q": ("f8", pair, "LCD px", "zero that was taken, less the warp at rest: seen = measured + zero")
    }
    pictures: Arrays = {"q": ("f8", pair, "LCD px", f"warp that was drawn: {lcd}")}
    frames: Arrays = {"image": (image, image_shape, "grey levels", "the frame as the camera gave it")}
    residual: Arrays = {
        "d": ("f4", pair, "camera px", "(u, v): what is seen at a node is shown at node + d"),
        "sigma": ("f4", pair, "camera px", "standard deviation of d"),
        "flags": ("u2", nodes, "", why),
        "mean": ("f4", nodes, "grey levels", "mean grey around the node, black level included"),
    }
    measured: Arrays = {
        "q": ("f8", pair, "LCD px", f"warp by this frame alone, from the zero taken last: {lcd}"),
        "sigma": ("f8", pair, "LCD px", "standard deviation of q"),
        "flags": ("u2", nodes, "", why),
    }
    commanded: Arrays = {"q": ("f4", pair, "LCD px", f"warp to be shown next: {lcd}")}
    shown: Arrays = {"q": ("f4", pair, "LCD px", f"mix of warps that the frame saw: {lcd}")}
    surface: Arrays = {
        "depth_mm": ("f4", nodes, "mm", "depth at the node's mirror point, positive into the rubber"),
        "slope": ("f4", pair, "rad", "(d depth/dx, d depth/dy)"),
        "x_mm": ("f4", nodes, "mm", "mirror point, world x"),
        "y_mm": ("f4", nodes, "mm", "mirror point, world y"),
        "sigma_depth_mm": ("f4", nodes, "mm", "standard deviation of depth"),
        "sigma_slope": ("f4", pair, "rad", "standard deviation of slope"),
        "valid": ("?", nodes, "", "nodes with a depth"),
        "contact": ("?", nodes, "", "light lost: total reflection fails or something touches"),
        "anchor": ("?", nodes, "", "nodes where depth was taken as known"),
    }
    groups: list[tuple[str, Arrays, str]] = [
        ("zeros", zeros, ""),
        ("frames", frames, "frames"),
        ("residual", residual, "residual"),
        ("warps/measured", measured, "warps"),
        ("warps/commanded", commanded, "warps"),
        ("warps/shown", shown, "warps"),
        ("surface", surface, "surface"),
    ]
    if every == 1:
        groups.append(("pictures", pictures, "warps"))
    found = list(tables)
    for group, arrays, kept in groups:
        if kept and kept not in keep:
            continue
        found.append(_number(group, kept))
        for name, (kind, shape, units, meaning) in arrays.items():
            found.append(Part(f"{group}/{name}", np.dtype(kind), shape, units, meaning, kept))
        if group == "surface":
            found.append(_table(group, READINGS, "what a reading is anchored to", kept))
        own = [part.name.rpartition("/")[2] for part in found if part.group == group]
        sums = {name: ("u8", "", f"sum of the item of {group}/{name}") for name in own}
        found.append(_table(group, sums, SUM_MEANING, kept, SUMS))
    return {part.name: part for part in found}


def _table(group: str, fields: Fields, meaning: str, kept: str = "", name: str = "table") -> Part:
    kind = np.dtype([(field, kind) for field, (kind, _, _) in fields.items()])
    return Part(f"{group}/{name}", kind, (), "see the attribute `fields`", meaning, kept, fields)


def number_name(group: str) -> str:
    """Dataset that numbers a group's items: `turn`; `row` of presentations/table for pictures."""
    return f"{group}/row" if group == "pictures" else f"{group}/turn"


def _number(group: str, kept: str) -> Part:
    meaning = {
        "zeros": "turn from which on readings start from this zero",
        "pictures": "row of presentations/table that item i of this group is the picture of",
    }.get(group, "turn of the loop that item i of this group belongs to")
    return Part(number_name(group), np.dtype("i8"), (), "", meaning, kept)
