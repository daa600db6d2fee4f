"""What is in a recording: every dataset with its type, units and meaning.

Datasets grow along their first axis, one item at a time. In a group with a dataset `step`, item i of every
dataset belongs to step `step[i]` of the loop. `step` grows last, so that a reader that follows the file finds
the others at least as long.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.recording.checksums import CHECKSUMS
from zeromethod.recording.contact_images import TILE_PX
from zeromethod.warp.grid import PADDING

SCHEMA = "zeromethod recording"
SCHEMA_VERSION = 3

LIGHT_ARRAYS = "zeromethod light arrays"
"""Format of recordings of LED and photodetector arrays, which have a layout of their own."""

KEEP = ("frames", "residual", "warps", "surface", "fine")
"""What may be kept or left out; tables are always kept. "fine": of a run that reads every pixel."""

STATES = tuple(State)
EVENTS = tuple(Event)
AnchorMode = Literal["none", "known", "quiet"]
ANCHORS: tuple[AnchorMode, ...] = ("none", "known", "quiet")

Fields = Mapping[str, tuple[str, str, str]]
"""Type, units and meaning of every field of a table."""


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


STEPS: Fields = {
    "number": ("i8", "", "number of the step, from 1"),
    "time_ns": ("i8", "ns", "mid-exposure of its frame on the run's clock, else when the step ended"),
    "exposure_ns": ("i8", "ns", "length of the exposure; 0 without a frame"),
    "frame_number": ("i8", "", "the camera's own count; -1 without a frame"),
    "dropped": ("i4", "frames", "frames that the camera lost since the one before"),
    "state": ("u1", "", "state of the loop after the step: index in the attribute `states`"),
    "frozen": ("?", "", "corrections were frozen on request, or paused"),
    "sensed": ("?", "", "the frame was usable and its residual was computed"),
    "residual_rms_px": ("f8", "camera px", "rms length of the residual over valid nodes"),
    "valid_share": ("f8", "", "valid nodes among those measurable at rest"),
    "loop_ms": ("f8", "ms", "from frame in hand to command"),
    "draw_ms": ("f8", "ms", "to draw and present a picture; NaN where none was presented"),
    "delay_ms": ("f8", "ms", "from mid-exposure until the panel's middle row is half-way to the new picture"),
    "events": ("u8", "", "what happened: bit i is entry i of the attribute `events`"),
    "phase": ("S16", "", "part of the simulated scenario; empty where unknown"),
    "reason": ("S160", "", "why the loop is in its state"),
}

PRESENTATION_LOG: Fields = {
    "after_step": ("i8", "", "last step whose frame was processed before this picture was noted as shown"),
    "time_ns": ("i8", "ns", "when it was given to the panel"),
    "newest_frame_ns": ("i8", "ns", "mid-exposure of the newest frame that it was made from; -1 for none"),
    "strip_code": ("i4", "", "code in its strips; -1 for none"),
    "draw_ms": ("f8", "ms", "to draw and present it"),
    "coded_picture": ("i4", "", "number of the burst's picture drawn over it; -1 for none"),
    "target_shift": ("(2,)f8", "periods", "of a moving target along u and v: T(u + s P) is shown; else 0"),
}

PEAKS: Fields = {
    "step": ("i8", "", "step that the surface was read from"),
    "time_ns": ("i8", "ns", "mid-exposure of that step's frame on the run's clock"),
    "state": ("u1", "", "state of the loop after that step: index in the attribute `states`"),
    "depth_mm": ("f8", "mm", "depth at the point of largest |depth|, positive into the rubber"),
    "depth_sigma_mm": ("f8", "mm", "standard deviation of depth_mm"),
    "possibly_deeper_mm": ("f8", "mm", "one-sided part of depth_sigma_mm: how much deeper holes may be"),
    "x_mm": ("f8", "mm", "world x of the point"),
    "y_mm": ("f8", "mm", "world y of the point"),
    "x_sigma_mm": ("f8", "mm", "standard deviation of x_mm"),
    "y_sigma_mm": ("f8", "mm", "standard deviation of y_mm"),
    "read_ms": ("f8", "ms", "how long reading the surface took"),
    "where": ("S16", "", "measured, beside a contact, or inside a contact: there carried in from around"),
    "total_force_n": ("f8", "N", "sum of the forces of all contacts; NaN: not known"),
    "sigma_total_force_n": ("f8", "N", "standard deviation of total_force_n"),
}

OUTLINE_POINTS = 64
"""Points of a contact's border that are kept."""

CONTACTS: Fields = {
    "step": ("i8", "", "step that it was seen in"),
    "time_ns": ("i8", "ns", "mid-exposure of that step's frame on the run's clock"),
    "id": ("i4", "", "the same from touch to lift"),
    "x_mm": ("f8", "mm", "world x of the centroid"),
    "y_mm": ("f8", "mm", "world y of the centroid"),
    "sigma_x_mm": ("f8", "mm", "standard deviation of x_mm"),
    "sigma_y_mm": ("f8", "mm", "standard deviation of y_mm"),
    "area_mm2": ("f8", "mm2", "area"),
    "sigma_area_mm2": ("f8", "mm2", "standard deviation of area_mm2"),
    "major_mm": ("f8", "mm", "longer axis of the ellipse of the same second moments, whole length"),
    "minor_mm": ("f8", "mm", "shorter one"),
    "angle_deg": ("f8", "deg", "direction of the longer one, from x towards y"),
    "sigma_edge_mm": ("f8", "mm", "standard deviation of the border across itself"),
    "leak_mm": ("f8", "mm", "how far the border was moved inwards for light that leaks beside it"),
    "scattered": ("f8", "", "light that comes out of the contact, over the picture's mean"),
    "depth_mm": ("f8", "mm", "depth at the deepest inside, carried in from around; NaN: not known"),
    "sigma_depth_mm": ("f8", "mm", "standard deviation of depth_mm"),
    "age_s": ("f8", "s", "time since it was first seen"),
    "force_n": ("f8", "N", "force into the rubber; NaN: not known"),
    "sigma_force_n": ("f8", "N", "standard deviation of force_n"),
    "torque_x_nmm": ("f8", "N mm", "torque about x through the centroid"),
    "sigma_torque_x_nmm": ("f8", "N mm", "standard deviation of torque_x_nmm"),
    "torque_y_nmm": ("f8", "N mm", "torque about y through the centroid"),
    "sigma_torque_y_nmm": ("f8", "N mm", "standard deviation of torque_y_nmm"),
    "outline_mm": (f"({OUTLINE_POINTS},2)f4", "mm", "(x, y) of points evenly along the border"),
}

CONTACT_IMAGES: Fields = {
    "step": ("i8", "", "step that it was seen in"),
    "id": ("i4", "", "of the contact"),
    "x_mm": ("f8", "mm", "world x of the middle of the image's pixel (0, 0); columns go along x"),
    "y_mm": ("f8", "mm", "world y of it; rows go along y"),
    "mm_per_px": ("f8", "mm", "side of a pixel"),
    "rows": ("i4", "px", "of the whole image"),
    "cols": ("i4", "px", "of the whole image"),
    "row": ("i4", "px", "first row of this tile in it"),
    "col": ("i4", "px", "first column of this tile in it"),
    "light": (f"({TILE_PX},{TILE_PX})f2", "", "light over the picture's mean in the null; NaN out of view"),
}

DROPS: Fields = {
    "step": ("i8", "", "step in which frames were found missing, or whose arrays were not kept"),
    "time_ns": ("i8", "ns", "time of that step"),
    "count": ("i4", "frames", "how many"),
    "lost_by": ("S16", "", "camera: never reached the loop; recorder: processed, but arrays not kept"),
    "reason": ("S120", "", "why"),
}

NOTES: Fields = {
    "step": ("i8", "", "step"),
    "time_ns": ("i8", "ns", "time of that step"),
    "text": ("S240", "", "message to the operator"),
}

CALLS: Fields = {
    "step": ("i8", "", "step in which it was carried out, before its frame was measured"),
    "time_ns": ("i8", "ns", "time of that step"),
    "method": ("S24", "", "name of the method (docs/page.md)"),
    "arguments": ("S400", "", "its arguments, JSON"),
    "source": ("S16", "", "who called: terminal, page, http, socket or python"),
    "outcome": ("S160", "", "done, or why it was refused"),
}

APPROACHES: Fields = {
    "step": ("i8", "", "step that it was newest in"),
    "time_ns": ("i8", "ns", "mid-exposure of the watch camera's frame on the run's clock"),
    "watching": ("S24", "", "what the watch camera sees: clear, seen, coming, or why it sees nothing"),
    "height_mm": ("f8", "mm", "of the lowest place of what comes, over the mirror; NaN: not known"),
    "sigma_height_mm": ("f8", "mm", "standard deviation of height_mm"),
    "speed_mm_s": ("f8", "mm/s", "towards the mirror"),
    "sigma_speed_mm_s": ("f8", "mm/s", "standard deviation of speed_mm_s"),
    "contact_s": ("f8", "s", "from time_ns until it touches"),
    "sigma_contact_s": ("f8", "s", "standard deviation of contact_s"),
    "x_mm": ("f8", "mm", "world x of the touch to come"),
    "y_mm": ("f8", "mm", "world y of it"),
    "sigma_x_mm": ("f8", "mm", "standard deviation of x_mm"),
    "sigma_y_mm": ("f8", "mm", "standard deviation of y_mm"),
    "diameter_mm": ("f8", "mm", "width of what comes, of a long thing the shorter one"),
    "sigma_diameter_mm": ("f8", "mm", "standard deviation of diameter_mm"),
}

CONTACT_STATUS: Fields = {
    "step": ("i8", "", "step that it was read from"),
    "time_ns": ("i8", "ns", "mid-exposure of that step's frame on the run's clock"),
    "contact_id": ("i4", "", "contact that it is of"),
    "looked_mm2": ("f8", "mm2", "area looked at; this and all that follows: NaN where not known"),
    "share": ("f8", "", "of that area in contact"),
    "sigma_share": ("f8", "", "standard deviation of share"),
    "spots_per_cm2": ("f8", "1/cm2", "spots in contact"),
    "sigma_spots_per_cm2": ("f8", "1/cm2", "standard deviation of spots_per_cm2, as a sample of the texture"),
    "spot_mm2": ("f8", "mm2", "mean size of a spot"),
    "sigma_spot_mm2": ("f8", "mm2", "standard deviation of spot_mm2"),
    "spot_life_s": ("f8", "s", "mean time that a spot stays in contact"),
    "sigma_spot_life_s": ("f8", "s", "standard deviation of spot_life_s"),
    "speed_mm_s": ("f8", "mm/s", "sliding along the mirror"),
    "sigma_speed_mm_s": ("f8", "mm/s", "standard deviation of speed_mm_s"),
    "direction_deg": ("f8", "deg", "of sliding, from x towards y"),
    "sigma_direction_deg": ("f8", "deg", "standard deviation of direction_deg"),
    "pitch_mm": ("f8", "mm", "from ridge to ridge, or row to row"),
    "sigma_pitch_mm": ("f8", "mm", "standard deviation of pitch_mm"),
    "ridge_deg": ("f8", "deg", "the way across ridges, from x towards y"),
    "sigma_ridge_deg": ("f8", "deg", "standard deviation of ridge_deg"),
    "force_n": ("f8", "N", "of the contact, into the rubber"),
    "sigma_force_n": ("f8", "N", "standard deviation of force_n"),
    "motion": ("S8", "", "stick, slip or unknown"),
    "began_s": ("f8", "s", "how long it has moved so"),
    "event": ("S8", "", "stick or slip where it is named in this frame"),
    "aliased": (
        "?",
        "",
        "it moves over half a pitch from frame to frame or while one is exposed, or is not clear",
    ),
    "reason": ("S160", "", "why what is NaN is not known"),
}

READINGS: Fields = {
    "time_ns": ("i8", "ns", "mid-exposure of the frame that it was read from"),
    "iterations": ("i4", "", "ray-surface intersections taken until depth settled"),
    "anchor": ("u1", "", "where depth was taken as known: index in the attribute `anchors`"),
    "anchor_sigma_mm": ("f8", "mm", "standard deviation that depth owes to the anchor"),
    "anchor_tail_mm": ("f8", "mm", "depth that the anchor's nodes still have, over the reader's scale"),
}

FINE_READINGS: Fields = {
    "frames": ("i4", "frames", "frames read together, the last of them that of its step"),
    "first_row": ("i4", "px", "camera row of pixel (0, 0)"),
    "first_col": ("i4", "px", "camera column of pixel (0, 0)"),
    "footprint_divided": ("?", "", "whether the pupil's footprint and the lens's blur are divided out"),
}

FINE_PEAKS: Fields = {
    "step": ("i8", "", "step of the newest frame that the fine surface was read from"),
    "time_ns": ("i8", "ns", "mid-exposure of that frame on the run's clock"),
    "frames": ("i4", "frames", "frames read together"),
    "depth_mm": ("f8", "mm", "depth where |depth| is largest, positive into the rubber"),
    "depth_sigma_mm": ("f8", "mm", "standard deviation of depth at the pixel next to it"),
    "x_mm": ("f8", "mm", "world x of the point"),
    "y_mm": ("f8", "mm", "world y of the point"),
    "valid_share": ("f8", "", "pixels with a depth"),
}

TABLES: Mapping[str, tuple[Fields, str]] = {
    "steps": (STEPS, "one row per step of the loop"),
    "presentation_log": (PRESENTATION_LOG, "one row per picture given to the panel"),
    "peaks": (PEAKS, "point of largest |depth| of every surface that was read"),
    "contacts": (CONTACTS, "what touches the mirror, one row per contact and frame that was read"),
    "contact_images": (CONTACT_IMAGES, "what touches as an image, one row per tile, where surfaces are kept"),
    "fine_peaks": (FINE_PEAKS, "point of largest |depth| of every fine surface that was read"),
    "drops": (DROPS, "frames that are not in this file"),
    "notes": (NOTES, "messages to the operator"),
    "approaches": (APPROACHES, "what comes, one row per frame of the watch camera that was looked at"),
    "contact_status": (
        CONTACT_STATUS,
        "how a texture rubs along the mirror, one row per frame that was read",
    ),
    "calls": (CALLS, "methods that a person or a program called during the run"),
}

LATER = frozenset({"contacts", "contact_images", "fine_peaks", "approaches", "contact_status", "calls"})
"""Tables that files of this format may lack."""

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
) -> dict[str, Part]:
    """Datasets that grow, by name. image_shape: (rows, cols) px. grid_shape: (rows, cols) nodes.

    fine_shape: pixels (rows, cols) of fine surfaces; None: the run reads none.

    The warps of all pictures are kept only where every frame is: only then can frames be processed again.
    """
    shapes = {"image": image_shape, "nodes": grid_shape, "pairs": (*grid_shape, 2)}
    if fine_shape is not None:
        lattice = grid_shape[0] - 2 * PADDING, grid_shape[1] - 2 * PADDING
        shapes |= {"pixels": fine_shape, "pixel pairs": (*fine_shape, 2), "lattice": lattice}
    groups: dict[str, list[Part]] = {}
    for name, kind, shape, units, meaning in ARRAYS:
        group = name.rpartition("/")[0]
        kept = _KEPT.get(group, group.partition("/")[0])
        left_out = kept == "fine" and fine_shape is None
        if left_out or (kept and kept not in keep) or (group == "pictures" and every != 1):
            continue
        number = Part(number_name(group), np.dtype("i8"), (), "", _NUMBERS.get(group, _OF_STEP), kept)
        dtype = np.dtype("u2" if shape == "image" and bits > 8 else kind)
        own = groups.setdefault(group, [number])
        own.append(Part(name, dtype, shapes[shape], units, meaning, kept))
    found: list[Part] = []
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


def row_dtype(fields: Fields) -> np.dtype[Any]:
    """Of a table's rows."""
    return np.dtype([(field, kind) for field, (kind, _, _) in fields.items()])


def _table(group: str, fields: Fields, meaning: str, kept: str = "", name: str = "table") -> Part:
    return Part(f"{group}/{name}", row_dtype(fields), (), "see the attribute `fields`", meaning, kept, fields)


def _checksums(group: str, own: Collection[Part], kept: str = "") -> Part:
    """Dataset with the checksums of a group's others."""
    fields = {part.name.rpartition("/")[2]: ("u8", "", f"checksum of {part.name}") for part in own}
    return _table(group, fields, CHECKSUM_MEANING, kept, CHECKSUMS)


def number_name(group: str) -> str:
    """Dataset that numbers a group's items: `step`; `row` of presentation_log/table for pictures."""
    return f"{group}/row" if group == "pictures" else f"{group}/step"
