"""The surface at one time as a mesh in mm: PLY with depth and sigma at every vertex, STL."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError, MeasurementError
from zeromethod.export.selection import SelectedSteps, needed
from zeromethod.export.source import MapSource
from zeromethod.fine.surface import FineSurface
from zeromethod.optics.mirror import HeightField, rest_surface
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface

_HEADER = "zeromethod: mm; z = rest - depth out of the rubber, x along the mirror from the edge P0"


def export_mesh(
    recording: Recording,
    selected: SelectedSteps,
    path: Path,
    advance: Callable[[], None],
    *,
    form: str,
    fine: bool = False,
) -> dict[str, Any]:
    """Write the surface of the one moment given; `form` is "ply" or "stl".

    Returns what was written: time, vertices, faces, the depth (signed) where |depth| is largest, mm. Raises
    MeasurementError where no three neighbouring nodes were read.
    """
    trimesh = needed("trimesh")
    source = MapSource(recording, fine)
    if recording.is_damaged(source.group, int(selected.steps[0])):
        at_s = f"{selected.time_s[0]:.3f} s"
        raise InputError(f"{recording.path}: the surface at {at_s} is damaged: give another time (--at)")
    surface = source.read(int(selected.steps[0]))
    vertices, faces, nodes = _triangles(recording, surface)
    if not len(faces):
        raise MeasurementError(f"at {selected.time_s[0]:.3f} s no part of the surface was read")
    depth_mm = surface.depth_mm[nodes]
    mesh = trimesh.Trimesh(vertices=vertices, faces=faces, process=False)
    mesh.units = "mm"
    if form == "ply":
        mesh.vertex_attributes["depth_mm"] = depth_mm.astype(np.float32)
        mesh.vertex_attributes["sigma_depth_mm"] = surface.sigma_depth_mm[nodes].astype(np.float32)
        first, rest = mesh.export(file_type="ply").split(b"\nformat ", 1)
        data = first + b"\nformat " + rest.replace(b"\n", b"\ncomment " + _HEADER.encode() + b"\n", 1)
    else:
        # A binary STL begins with 80 bytes of free text; the word "solid" there would make it a text file.
        data = _HEADER.encode().ljust(80)[:80] + mesh.export(file_type="stl")[80:]
    with atomic_write(path) as part:
        part.write_bytes(data)
    advance()
    return {
        "time_s": float(selected.time_s[0]),
        "vertices": len(vertices),
        "faces": len(faces),
        "depth_largest_mm": float(depth_mm[np.argmax(np.abs(depth_mm))]),
    }


def surface_points(surface: Surface | FineSurface, rest: HeightField) -> Float:
    """World points (rows, cols, 3) in mm of every node; z NaN where not valid.

    Convention: origin P0, x along the mirror, z = h_rest(x, y) - depth out of the rubber.
    """
    x, y = (np.asarray(values, dtype=np.float64) for values in (surface.x_mm, surface.y_mm))
    z = rest.height(x, y) - np.where(surface.valid, surface.depth_mm, np.nan)
    return np.stack([x, y, z], axis=-1)


def _triangles(recording: Recording, surface: Surface | FineSurface) -> tuple[Float, Ints, Mask]:
    """Vertices (n, 3), faces (m, 3) counter-clockwise from outside, and the mask of the vertices' nodes."""
    points = surface_points(surface, rest_surface(recording.rig))
    known = np.asarray(np.isfinite(points).all(axis=-1))
    number = np.cumsum(known).reshape(known.shape) - 1
    corners = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None))]
    corners += [(slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]
    a, b, c, d = (number[corner] for corner in corners)
    in_a, in_b, in_c, in_d = (known[corner] for corner in corners)
    faces = np.concatenate(
        [
            np.stack([p, q, r], axis=-1)[has]
            for p, q, r, has in (
                (a, b, c, in_a & in_b & in_c),
                (a, c, d, in_a & in_c & in_d),
                # A cell with one corner missing, on the other diagonal, still has a triangle.
                (a, b, d, in_a & in_b & in_d & ~in_c),
                (b, c, d, in_b & in_c & in_d & ~in_a),
            )
        ]
    )
    vertices = points[known]
    first, second, third = (vertices[faces[:, k], :2] for k in range(3))
    area = _area(first, second, third)
    faces[area < 0.0] = faces[area < 0.0][:, ::-1]
    return vertices, faces, known


def _area(first: Float, second: Float, third: Float) -> Float:
    """Twice the area of triangles in (x, y), positive where counter-clockwise."""
    p, q = second - first, third - first
    return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
