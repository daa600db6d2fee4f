"""Contacts of a recording in the terms of its maps: which node lies in which, and their images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Image, Ints, Mask
from zeromethod.export.selection import SelectedSteps
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface

PLACES = np.dtype([("step", "i8"), ("id", "i4"), ("x_mm", "f8"), ("y_mm", "f8"), ("mm_per_px", "f8")])


def contact_ids(surface: Surface, contacts: Image) -> Ints:
    """(rows, cols) id of the contact within whose border a node lies; 0 for none."""
    found = np.zeros(surface.x_mm.shape, np.int64)
    for contact in contacts:
        found[_within(surface.x_mm, surface.y_mm, contact["outline_mm"].astype(np.float64))] = contact["id"]
    return found


def _within(x: Float, y: Float, border: Float) -> Mask:
    """Points inside a closed polygon (n, 2): those from which a ray crosses it an odd number of times."""
    crossed = np.zeros(x.shape, np.bool_)
    for (x1, y1), (x2, y2) in zip(border, np.roll(border, -1, axis=0), strict=True):
        if y1 != y2:
            crossed ^= ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) * (x2 - x1) / (y2 - y1))
    return crossed


def contact_images(
    recording: Recording, selected: SelectedSteps
) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Arrays of an archive: every contact's image at every moment, and where they lie."""
    places = []
    for step in selected.steps:
        for number, image in recording.contact_images(int(step)).items():
            places.append((step, number, image.x_mm, image.y_mm, image.mm_per_px))
            yield f"contact_images/{step}-{number}", image.light
    yield "contact_images", np.array(places, PLACES)
