"""One message: a line that names the version, a line of JSON, then the maps.

It is one part, so that a socket can keep the newest message and drop the others.
The layout is documented in docs/live-output.md; a change that a reader would notice raises SCHEMA_VERSION.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from zeromethod.approach import Approach
from zeromethod.arrays import Image
from zeromethod.contact import Contact
from zeromethod.loop.step import Step
from zeromethod.publishing.events import ContactEvent
from zeromethod.rubbing import ContactStatus
from zeromethod.surface import Peak

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

MAPS = (
    ("depth_mm", "<f4", "mm"),
    ("sigma_depth_mm", "<f4", "mm"),
    ("slope", "<f4", "1"),
    ("x_mm", "<f4", "mm"),
    ("y_mm", "<f4", "mm"),
    ("sigma_x_mm", "<f4", "mm"),
    ("sigma_y_mm", "<f4", "mm"),
    ("valid", "|u1", ""),
    ("contact", "|u1", ""),
)
"""Name, little-endian type and unit of every map, in the order in which they lie one after the other."""


def encode(
    step: Step,
    *,
    session: str,
    unix_time_ns: int,
    touching: bool,
    contacts: Iterable[ContactEvent],
) -> bytes:
    """Message of one step of the loop; without a surface it has no maps."""
    maps: list[Image] = []
    described: list[dict[str, Any]] = []
    for name, dtype, unit in () if step.surface is None else MAPS:
        offset = sum(values.nbytes for values in maps)
        maps.append(np.ascontiguousarray(getattr(step.surface, name), dtype))
        about = {"name": name, "dtype": dtype, "shape": maps[-1].shape, "order": "C"}
        described.append(about | {"unit": unit, "offset": offset})
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
        "calibrated": step.calibrated,
        "dropped": step.dropped,
        "residual_rms_px": _number(step.residual_rms_px),
        "valid_share": _number(step.valid_share),
        "pose": WORLD_FRAME,
        "peak": None if step.peak is None else _peak(step.peak),
        "touching": touching,
        "contacts": [_contact(event) for event in contacts],
        "in_contact": [_area(contact) for contact in step.contacts],
        "total_force_n": _number(step.total_force_n),
        "sigma_total_force_n": _number(step.sigma_total_force_n),
        "contact_status": None if step.contact_status is None else _numbers(step.contact_status),
        "approach": None if step.approach is None else _numbers(step.approach),
        "arrays": described,
    }
    text = json.dumps(header, allow_nan=False).encode()
    return b"".join((TOPIC, text, b"\n", *(values.data for values in maps)))


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _peak(peak: Peak) -> dict[str, float | str | None]:
    numbers = {name: _number(getattr(peak, name)) for name in ("depth_mm", "x_mm", "y_mm")}
    sigmas = {"depth": peak.sigma_mm, "x": peak.sigma_x_mm, "y": peak.sigma_y_mm}
    stated = {f"{name}_sigma_mm": _number(sigma) for name, sigma in sigmas.items()}
    return {**numbers, **stated, "where": peak.where.value}


def _numbers(of: Approach | ContactStatus) -> dict[str, Any]:
    figures = asdict(of)
    return {name: _number(one) if isinstance(one, float) else one for name, one in figures.items()}


def _area(contact: Contact) -> dict[str, Any]:
    outline = np.round(contact.outline_mm, 4).tolist()
    figures = {name: _number(value) for name, value in asdict(contact.figures).items()}
    return figures | {"outline_mm": outline}


def _contact(event: ContactEvent) -> dict[str, Any]:
    place = {name: _number(getattr(event, name)) for name in ("x_mm", "y_mm", "depth_mm")}
    return {"number": event.number, "kind": event.kind, "time_ns": event.time_ns, **place}
