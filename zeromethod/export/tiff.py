"""Depth and slope on a regular lattice in mm over time, as a float TIFF (OME: units, spacing, times)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.arrays import Single
from zeromethod.atomic_write import atomic_write
from zeromethod.export.lattice import MapLattice, Resampler
from zeromethod.export.selection import SelectedSteps, needed
from zeromethod.export.source import MapSource
from zeromethod.recording.recording import Recording

CHANNELS = ("depth, mm", "slope d depth / dx, rad", "slope d depth / dy, rad")

_LARGEST_CLASSIC = 4_000_000_000
"""Bytes above which the offsets of a classic TIFF no longer reach."""


def export_tiff(
    recording: Recording,
    selected: SelectedSteps,
    path: Path,
    advance: Callable[[], None],
    *,
    pitch_mm: float | None = None,
    fine: bool = False,
) -> dict[str, Any]:
    """Write float32 pages (times, channels, rows, columns), one time after the other.

    Row j grows with y, column i with x; NaN where not read. The lattice is that of the first surface.
    Returns what was written: times, rows, columns, pitch and the first point, mm.
    """
    tifffile = needed("tifffile")
    source = MapSource(recording, fine)
    first = source.first(selected.steps.tolist())
    x_mm, y_mm = (one[source.inner].astype(np.float64) for one in (first.x_mm, first.y_mm))
    lattice = MapLattice.covering(x_mm, y_mm, pitch_mm)
    rows, cols = lattice.shape
    shape = (len(selected.steps), len(CHANNELS), rows, cols)
    large = 4 * np.prod(shape, dtype=float) > _LARGEST_CLASSIC
    with atomic_write(path) as part, tifffile.TiffWriter(part, ome=True, bigtiff=large) as file:
        file.write(
            _pages(source, selected, lattice, advance),
            shape=shape,
            dtype=np.float32,
            photometric="minisblack",
            resolution=(10.0 / lattice.pitch_mm, 10.0 / lattice.pitch_mm),
            resolutionunit="CENTIMETER",
            metadata=_metadata(selected, lattice),
        )
    place = {"pitch_mm": lattice.pitch_mm, "x0_mm": lattice.x0_mm, "y0_mm": lattice.y0_mm}
    return {"times": shape[0], "rows": rows, "columns": cols, **place}


def _pages(
    source: MapSource, selected: SelectedSteps, lattice: MapLattice, advance: Callable[[], None]
) -> Iterator[Single]:
    resampled = Resampler(lattice)
    inner = source.inner
    for step in selected.steps.tolist():
        surface = source.read(step)
        values = np.concatenate([surface.depth_mm[..., None], surface.slope], axis=-1)[inner]
        x_mm, y_mm = (one[inner].astype(np.float64) for one in (surface.x_mm, surface.y_mm))
        maps = resampled(x_mm, y_mm, surface.valid[inner], values)
        yield from np.moveaxis(maps, -1, 0).astype(np.float32)
        advance()


def _metadata(selected: SelectedSteps, lattice: MapLattice) -> dict[str, Any]:
    """What OME-XML can say: spacing, the first point's place, names and units, times."""
    planes = len(selected.steps) * len(CHANNELS)
    plane = {"DeltaT": np.repeat(selected.time_s, len(CHANNELS)).tolist(), "DeltaTUnit": ["s"] * planes}
    found: dict[str, Any] = {"axes": "TCYX", "Channel": {"Name": list(CHANNELS)}, "Plane": plane}
    for axis, start_mm in (("X", lattice.x0_mm), ("Y", lattice.y0_mm)):
        plane |= {f"Position{axis}": [start_mm] * planes, f"Position{axis}Unit": ["mm"] * planes}
        found |= {f"PhysicalSize{axis}": lattice.pitch_mm, f"PhysicalSize{axis}Unit": "mm"}
    about = "zeromethod: depth positive into the rubber, mm; x along the mirror from the edge P0"
    return found | {"TimeIncrement": selected.interval_s, "TimeIncrementUnit": "s", "Description": about}
