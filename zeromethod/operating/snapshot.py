"""A snapshot: the camera's newest picture as .png, and what was read as .npz."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.loop.step import Step

MAPS = ("depth_mm", "sigma_depth_mm", "slope", "x_mm", "y_mm", "valid", "contact")


def free_stem(stem: Path) -> Path:
    """The same, with a number where a file of that name is there already."""
    free, count = stem, 1
    while any(free.with_name(free.name + suffix).exists() for suffix in (".png", ".npz")):
        count += 1
        free = stem.with_name(f"{stem.name}-{count}")
    return free


def save_snapshot(stem: Path, newest: Step, read: Step | None, note: str = "") -> list[str]:
    """Write STEM.png and STEM.npz; the names of both. Raises OSError, and InputError for a picture.

    newest: with an image. read: the newest one with a surface; None: nothing has been read.
    """
    stem = free_stem(stem)
    picture, arrays = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".npz")
    assert newest.image is not None
    good, encoded = cv2.imencode(".png", newest.image)
    if not good:
        raise InputError(f"snapshot: a picture of {newest.image.dtype} cannot be written as .png")
    found: dict[str, Any] = {
        "note": note,
        "state": newest.state.value,
        "step": newest.number,
        "time_ns": newest.time_ns,
        "image": newest.image,
        "residual_px": newest.residual_rms_px,
    }
    if read is not None and read.surface is not None and read.peak is not None:
        found |= {name: getattr(read.surface, name) for name in MAPS}
        peak = read.peak
        found |= {"surface_time_ns": read.surface.time_ns, "peak_mm": peak.depth_mm}
        found |= {"peak_x_mm": peak.x_mm, "peak_y_mm": peak.y_mm, "peak_sigma_mm": peak.sigma_mm}
    with atomic_write(picture) as part:
        part.write_bytes(encoded.tobytes())
    with atomic_write(arrays) as part, part.open("wb") as file:
        np.savez_compressed(file, **found)
    return [picture.name, arrays.name]
