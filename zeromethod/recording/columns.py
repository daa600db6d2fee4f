"""Columns of every table in a recording: name, type, units, meaning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from zeromethod.recording.contact_images import TILE_PX

Fields = Mapping[str, tuple[str, str, str]]
"""Type, units and meaning of every field of a table."""

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
    "lasts_s": ("f8", "s", "how long it has moved so"),
    "event": ("S8", "", "stick or slip where it is named in this frame"),
    "aliased": (
        "?",
        "",
        "it moves over half a pitch from frame to frame or while one is exposed, or is not clear",
    ),
    "reason": ("S160", "", "why what is NaN is not known"),
}

POINTERS: Fields = {
    "step": ("i8", "", "step that it was newest in"),
    "time_ns": ("i8", "ns", "mid-exposure of the frame that says so; of a cancel, time of its step"),
    "number": ("i8", "", "events of the run so far, this one included"),
    "type": ("S16", "", "pointerdown, pointermove, pointerup or pointercancel"),
    "pointer_id": ("i4", "", "the same from down to up or cancel: the contact's"),
    "is_primary": ("?", "", "no other finger was down when it came"),
    "x_mm": ("f8", "mm", "world x of the finger"),
    "y_mm": ("f8", "mm", "world y of it"),
    "sigma_x_mm": ("f8", "mm", "standard deviation of x_mm"),
    "sigma_y_mm": ("f8", "mm", "standard deviation of y_mm"),
    "x_px": ("f8", "projector px", "column of the projector's picture"),
    "y_px": ("f8", "projector px", "row of it"),
    "sigma_px": ("f8", "projector px", "standard deviation of x_px and y_px"),
    "width_px": ("f8", "projector px", "extent of the contact along the picture's columns"),
    "height_px": ("f8", "projector px", "extent of the contact along its rows"),
    "pressure": ("f8", "", "0 to 1: force over projector.full_force_n"),
    "force_n": ("f8", "N", "force; NaN: not known"),
    "sigma_force_n": ("f8", "N", "standard deviation of force_n"),
    "reason": ("S160", "", "why a pointer was cancelled"),
}

READINGS: Fields = {
    "time_ns": ("i8", "ns", "mid-exposure of the frame that it was read from"),
    "iterations": ("i4", "", "ray-surface intersections taken until depth settled"),
    "anchor": ("u1", "", "where depth was taken as known: index in the attribute `anchors`"),
    "anchor_sigma_mm": ("f8", "mm", "standard deviation that depth owes to the anchor"),
    "anchor_tail_mm": ("f8", "mm", "depth that the anchor's nodes still have, over the reader's scale"),
    "anchor_learned_ns": ("i8", "ns", "picture from which it was learned which loads press; 0: none was"),
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
    "pointers": (POINTERS, "what fingers do on an interactive surface, one row per pointer event"),
    "calls": (CALLS, "methods that a person or a program called during the run"),
}

LATER = frozenset(
    {"contacts", "contact_images", "fine_peaks", "approaches", "contact_status", "pointers", "calls"}
)
"""Tables that files of this format may lack."""


def row_dtype(fields: Fields) -> np.dtype[Any]:
    """Of a table's rows."""
    return np.dtype([(field, kind) for field, (kind, _, _) in fields.items()])
