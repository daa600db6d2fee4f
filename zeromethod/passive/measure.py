"""The passive sensor: still images against a reference, to displacement and, with a rig, to depth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Image
from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.passive import Displacement, correlate
from zeromethod.passive.correlate import SPACING_PX
from zeromethod.passive.passive_warp import measured_warp
from zeromethod.rig.model import Rig
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.grid import NodeGrid


@dataclass(frozen=True, slots=True)
class StillReading:
    """One image measured against the reference; surface, peak and grid only with a rig.

    surface is None, too, where the displacement leaves no node to read.
    """

    name: str
    displacement: Displacement
    surface: Surface | None = None
    peak: Peak | None = None
    grid: NodeGrid | None = None


def read_grey(path: Path) -> Image:
    """Image file as grey levels (rows, cols), 8 or 16 bits; colour as luminance.

    Raises InputError for a file that is missing or no image.
    """
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): an image file") from error
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: not an image of 8 or 16 bits that can be read (tif, bmp, png, ...)")
    if image.ndim == 2 or image.shape[2] == 1:
        return np.asarray(image.reshape(image.shape[:2]))
    code = cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(image, code))


class Measurement:
    """Measures image files against one reference, one after the other.

    Each image is also tried from the field of the one before, so a sequence may move by many periods of a
    regular texture as long as its neighbours do not.
    """

    def __init__(
        self,
        reference: Path,
        *,
        rig: Rig | None = None,
        spacing_px: int = SPACING_PX,
        window_px: float | None = None,
    ) -> None:
        """Read the reference, taken with the mirror at rest; place the rig's rays.

        Raises InputError for a file that is no image, or not of the rig's camera.
        """
        self.reference = read_grey(reference)
        self._rig = rig
        self._options: dict[str, Any] = {"window_px": window_px, "spacing_px": spacing_px}
        self._before: Displacement | None = None
        if rig is not None:
            expected = rig.camera.rows, rig.camera.columns
            if self.reference.shape != expected:
                raise InputError(
                    f"{reference}: {_size(self.reference)}: the rig's camera has {_size(expected)}"
                )
            self._optics = Optics(rig)
            self._grid = NodeGrid(expected, rig.target.period_px)
            self._reader = SurfaceReader(rig, self._optics, self._grid)

    def load(self, path: Path) -> Image:
        """Grey levels of an image; InputError unless it has the reference's size."""
        image = read_grey(path)
        if image.shape != self.reference.shape:
            raise InputError(f"{path}: {_size(image)}: the reference has {_size(self.reference)}")
        return image

    def measure(self, path: Path) -> StillReading:
        """Displacement of one image and, with a rig, the surface that made it."""
        image = self.load(path)
        displacement = correlate(self.reference, image, guess=self._before, **self._options)
        if not displacement.valid.any():
            return StillReading(path.stem, displacement)
        self._before = displacement
        if self._rig is None:
            return StillReading(path.stem, displacement)
        warp = measured_warp(displacement, self._optics, self._grid)
        if not warp.valid.any():
            return StillReading(path.stem, displacement, grid=self._grid)
        surface = self._reader.read(warp)
        return StillReading(path.stem, displacement, surface, peak(surface), self._grid)


def measure_all(measurement: Measurement, paths: Sequence[Path]) -> Iterator[StillReading]:
    """Measure images in order. All are read once before, so a bad one is refused before the work."""
    for path in paths:
        measurement.load(path)
    for path in paths:
        yield measurement.measure(path)


def figures(reading: StillReading) -> dict[str, Any]:
    """Figures of one image, px and mm, as the table and the summary give them; NaN where not measured."""
    found = reading.displacement
    valid = found.valid
    length, sigma = np.hypot(found.du, found.dv)[valid], found.sigma[valid]
    if not length.size:
        length = sigma = np.array([np.nan])
    out: dict[str, Any] = {
        "name": reading.name,
        "valid_share": float(valid.mean()),
        "displacement_median_px": float(np.median(length)),
        "displacement_largest_px": float(length.max()),
        "sigma_median_px": float(np.median(sigma)),
        "noise_grey": found.noise_grey,
    }
    if reading.grid is not None:
        out["depth_peak_mm"] = reading.peak.depth_mm if reading.peak else float("nan")
        out["depth_peak_sigma_mm"] = reading.peak.sigma_mm if reading.peak else float("nan")
    return out


def arrays(reading: StillReading) -> dict[str, Image]:
    """Everything that was measured, by the names that a result file has."""
    found = reading.displacement
    names = ("u", "v", "du", "dv", "sigma", "sigma_u", "sigma_v", "valid", "doubts")
    out: dict[str, Image] = {name: getattr(found, name) for name in names}
    if reading.surface is not None and reading.grid is not None:
        out["node_u"], out["node_v"] = reading.grid.mesh()
        for name in ("depth_mm", "sigma_depth_mm", "slope", "x_mm", "y_mm"):
            out[name] = getattr(reading.surface, name)
        out["depth_valid"] = reading.surface.valid
    return out


def _size(image: Image | tuple[int, ...]) -> str:
    rows, cols = image.shape if isinstance(image, np.ndarray) else image
    return f"{cols} x {rows} px"
