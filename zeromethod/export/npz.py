"""Slope and depth at the nodes over time, as a .npz for NumPy."""

from __future__ import annotations

import json
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.export.contact_nodes import contact_ids, contact_images
from zeromethod.export.selection import SelectedSteps
from zeromethod.export.source import MapSource
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface

_BLOCK = 1 << 22

_MAPS = {
    "depth_mm": ("<f4", "mm", "depth, positive into the rubber; NaN where not read"),
    "slope": ("<f4", "rad", "(d depth / dx, d depth / dy) along the last axis"),
    "sigma_depth_mm": ("<f4", "mm", "standard deviation of depth, what the geometry leaves open included"),
    "sigma_slope": ("<f4", "rad", "standard deviation of slope"),
    "x_mm": ("<f4", "mm", "mirror point of the node, along the mirror from the edge P0"),
    "y_mm": ("<f4", "mm", "mirror point of the node, along the prism"),
    "sigma_x_mm": ("<f4", "mm", "standard deviation of x_mm by what the geometry leaves open"),
    "sigma_y_mm": ("<f4", "mm", "standard deviation of y_mm, likewise"),
    "valid": ("|b1", "1", "whether depth was read at the node"),
    "contact": ("|b1", "1", "whether light was lost at the node"),
    "contact_id": ("<i4", "1", "contact within whose border the node lies, by its id; 0 for none"),
}
"""Type, unit and meaning of every map, (times, rows, columns[, 2])."""

_FINE_MAPS = {
    name: entry
    for name, entry in _MAPS.items()
    if name not in {"sigma_x_mm", "sigma_y_mm", "contact", "contact_id"}
} | {"share": ("<f4", "1", "1: read pixel by pixel; 0: interpolated between nodes, as the mirror moved")}
"""The same of maps of every pixel."""

_REST = {
    "time_s": ("s", "mid-exposure, since the recording's first step"),
    "time_ns": ("ns", "the same on the run's clock"),
    "step": ("1", "step of the loop"),
    "state": ("1", "the loop's state"),
    "u_px": ("px", "camera column of every column of nodes"),
    "v_px": ("px", "camera row of every row of nodes"),
    "contacts": (
        "1",
        "a row per contact and moment: id, place, area, axes, sigmas, its border",
    ),
    "contact_images": (
        "1",
        "a row per image: step, id, world place of its first pixel, mm per pixel; that of contact 1 in "
        "step 9 is contact_images/9-1: light over the picture's mean, rows along y, columns along x",
    ),
    "about": ("1", "this: unit and meaning of every array, the recording and its rig, as JSON"),
}


def export_npz(
    recording: Recording,
    selected: SelectedSteps,
    path: Path,
    advance: Callable[[], None],
    *,
    fine: bool = False,
) -> dict[str, Any]:
    """Write the maps of every moment; one of them at a time is in memory. fine: those of every pixel.

    Returns what was written: times, and rows and columns of the maps.
    """
    source = MapSource(recording, fine)
    inner, maps = source.inner, _FINE_MAPS if fine else _MAPS
    v_px, u_px = source.camera_px
    with ExitStack() as opened:
        part = opened.enter_context(atomic_write(path))
        scratch = {
            name: opened.enter_context(tempfile.TemporaryFile(dir=path.absolute().parent)) for name in maps
        }
        for step in selected.steps.tolist():
            surface = source.read(step)
            contacts = recording.contacts
            own = {}
            if isinstance(surface, Surface):
                own["contact_id"] = contact_ids(surface, contacts[contacts["step"] == step])
            for name, (dtype, _, _) in maps.items():
                values = own[name] if name in own else getattr(surface, name)
                scratch[name].write(np.ascontiguousarray(values[inner], dtype).data)
            advance()
        archive = opened.enter_context(
            zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, allowZip64=True, compresslevel=1)
        )
        small = {
            "time_s": selected.time_s,
            "time_ns": selected.time_ns,
            "step": selected.steps,
            "state": np.array(selected.states),
            "u_px": u_px,
            "v_px": v_px,
            "contacts": recording.contacts[np.isin(recording.contacts["step"], selected.steps)],
            "about": np.array(json.dumps(_about(recording, maps))),
        }
        for name, values in small.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(values), allow_pickle=False)
        for name, values in contact_images(recording, selected):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, values, allow_pickle=False)
        for name, (dtype, _, _) in maps.items():
            pair = (2,) if "slope" in name else ()
            shape = (len(selected.steps), len(v_px), len(u_px), *pair)
            _add(archive, name, np.dtype(dtype), shape, scratch[name])
        archive.close()
    return {"times": len(selected.steps), "rows": len(v_px), "columns": len(u_px)}


def _about(recording: Recording, maps: Mapping[str, tuple[str, str, str]]) -> dict[str, Any]:
    arrays = {name: {"unit": unit, "meaning": meaning} for name, (_, unit, meaning) in maps.items()}
    arrays |= {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in _REST.items()}
    return {"arrays": arrays, "started_utc": recording.started_utc, "rig": recording.rig_text}


def _add(
    archive: zipfile.ZipFile, name: str, dtype: np.dtype[Any], shape: tuple[int, ...], raw: IO[bytes]
) -> None:
    """One array of the archive, its values copied from a file of raw ones."""
    raw.seek(0)
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_2_0(member, header)
        while block := raw.read(_BLOCK):
            member.write(block)
