"""One message: a line that names the version, a line of JSON, then the maps.

It is one part, so that a socket can keep the newest message and drop the others.
The layout is documented in docs/live-output.md; a change that a reader would notice raises SCHEMA_VERSION.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from zeromethod.arrays import Image
from zeromethod.loop.step import Step
from zeromethod.publishing.events import ContactEvent
from zeromethod.surface import Peak, Surface

SCHEMA_VERSION = 2
TOPIC = f"zeromethod.v{SCHEMA_VERSION}\n".encode()
"""First line of every message; subscribe to it."""

WORLD_FRAME = {
    "frame_id": "zeromethod/P0",
    "unit": "mm",
    "origin": "P0: the edge where pattern face and mirror meet",
    "x": "along the mirror, towards the camera face",
    "y": "z cross x",
    "z": "out of the rubber; z = h_rest(x, y) - depth",
    "matrix": np.eye(4).tolist(),
}
"""Pose of the maps; `matrix` takes their x, y, z to `frame_id`."""


def encode(
    step: Step,
    *,
    session: str,
    unix_time_ns: int,
    touching: bool,
    contacts: Iterable[ContactEvent],
) -> bytes:
    """Message of one step of the loop; without a surface it has no maps."""
    maps = [] if step.surface is None else _maps(step.surface)
    offsets = np.cumsum([0, *(values.nbytes for _, values, _ in maps)]).tolist()
    described = [
        {
            "name": name,
            "dtype": values.dtype.str,
            "shape": values.shape,
            "order": "C",
            "unit": unit,
            "offset": offset,
        }
        for (name, values, unit), offset in zip(maps, offsets, strict=False)
    ]
    header = {
        "schema_version": SCHEMA_VERSION,
        "session": session,
        "step": step.number,
        "frame": step.frame_number,
        "time_ns": step.time_ns,
        "unix_time_ns": unix_time_ns,
        "state": step.state.value,
        "reason": step.reason,
        "events": [event.value for event in step.events],
        "dropped": step.dropped,
        "residual_rms_px": _number(step.residual_rms_px),
        "valid_share": _number(step.valid_share),
        "pose": WORLD_FRAME,
        "peak": None if step.peak is None else _peak(step.peak),
        "touching": touching,
        "contacts": [_contact(event) for event in contacts],
        "arrays": described,
    }
    return b"".join(
        (TOPIC, json.dumps(header, allow_nan=False).encode(), b"\n", *(values.data for _, values, _ in maps))
    )


def _maps(surface: Surface) -> list[tuple[str, Image, str]]:
    """Name, contiguous little-endian values and unit of every map."""
    lengths = (
        ("depth_mm", surface.depth_mm, "mm"),
        ("sigma_depth_mm", surface.sigma_depth_mm, "mm"),
        ("slope", surface.slope, "1"),
        ("x_mm", surface.x_mm, "mm"),
        ("y_mm", surface.y_mm, "mm"),
    )
    masks = (("valid", surface.valid), ("contact", surface.contact))
    return [
        *((name, np.ascontiguousarray(values, "<f4"), unit) for name, values, unit in lengths),
        *((name, np.ascontiguousarray(values, "|u1"), "") for name, values in masks),
    ]


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _peak(peak: Peak) -> dict[str, float | None]:
    numbers = {name: _number(getattr(peak, name)) for name in ("depth_mm", "x_mm", "y_mm")}
    return numbers | {"depth_sigma_mm": _number(peak.sigma_mm)}


def _contact(event: ContactEvent) -> dict[str, Any]:
    place = {name: _number(getattr(event, name)) for name in ("x_mm", "y_mm", "depth_mm")}
    return {"number": event.number, "kind": event.kind, "time_ns": event.time_ns, **place}
