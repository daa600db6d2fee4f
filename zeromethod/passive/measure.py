"""The passive sensor: still images against a reference, to displacement and, with a rig, to depth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Image
from zeromethod.calibration.nominal import stated
from zeromethod.errors import InputError
from zeromethod.optics import Optics, check_geometry
from zeromethod.passive import Displacement, PointFlag, correlate
from zeromethod.passive.bend import blurred, speck_px2, with_bend
from zeromethod.passive.correlate import SPACING_PX
from zeromethod.passive.passive_warp import measured_warp
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp


@dataclass(frozen=True, slots=True, repr=False)
class StillReading:
    """One image measured against the reference.

    Attributes
    ----------
    name : str
        Of the image: its file's, without the suffix.
    displacement : Displacement
        How far each point of the reference has moved, px.
    surface : Surface, optional
        Slope and depth; None without a rig, and where the displacement leaves no node to read.
    peak : Peak, optional
        The surface's deepest point.
    grid : NodeGrid, optional
        Nodes of the surface; None without a rig.
    calibrated : bool
        The rig's geometry is known; without, depth is relative, and its sigma says so.
    """

    name: str
    displacement: Displacement
    surface: Surface | None = None
    peak: Peak | None = None
    grid: NodeGrid | None = None
    calibrated: bool = True

    def __repr__(self) -> str:
        share = 100 * float(np.mean(self.displacement.valid))
        relative = "" if self.calibrated else " (relative: not calibrated)"
        read = "" if self.peak is None else f", {self.peak}{relative}"
        return f"<StillReading {self.name!r}: {share:.1f} % of the points valid{read}>"


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
    """Measurement of images against one reference, one after the other.

    Each image is also tried from the field of the one before, so a sequence may move by many periods of a
    regular texture as long as its neighbours do not.

    Parameters
    ----------
    reference : Path or (rows, cols) array
        Image taken with the mirror at rest, 8 or 16 bits.
    rig : Rig, optional
        Bench whose camera took the images; with it, slope and depth are read as well.
    spacing_px : int, optional
        Pixels between the points.
    window_px : float, optional
        Standard deviation of the Gaussian window; by default chosen for each point.
    largest_shift_px : float, optional
        How far any point may have moved; decides by how many periods a texture that repeats did.

    Raises
    ------
    InputError
        For a file that is no image, or an image that is not of the rig's camera.
    MeasurementError
        For a rig that is not calibrated and sees too little of the mirror to state what is open of depth.
    """

    def __init__(
        self,
        reference: Path | Image,
        *,
        rig: Rig | None = None,
        spacing_px: int = SPACING_PX,
        window_px: float | None = None,
        largest_shift_px: float | None = None,
    ) -> None:
        self.reference, name = _grey(reference, "reference")
        self.calibrated = rig is None or rig.geometry.known != "nominal"
        self._rig = rig
        self._options: dict[str, Any] = {"window_px": window_px, "spacing_px": spacing_px}
        self._options["largest_shift_px"] = largest_shift_px
        self._before: Displacement | None = None
        if rig is not None:
            expected = rig.camera.rows, rig.camera.columns
            if self.reference.shape != expected:
                raise InputError(f"{name}: {_size(self.reference)}: the rig's camera has {_size(expected)}")
            self._optics = Optics(rig)
            self._grid = NodeGrid.of_rig(rig)
            self._reader = SurfaceReader(stated(rig), self._optics, self._grid)

    def load(self, image: Path | Image) -> Image:
        """Grey levels of an image that has the reference's size.

        Parameters
        ----------
        image : Path or (rows, cols) array
            The image.

        Returns
        -------
        (rows, cols) array
            Its grey levels.

        Raises
        ------
        InputError
            For a file that is no image, or an image of another size.
        """
        grey, name = _grey(image, "image")
        if grey.shape != self.reference.shape:
            raise InputError(f"{name}: {_size(grey)}: the reference has {_size(self.reference)}")
        return grey

    def measure(self, image: Path | Image) -> StillReading:
        """Displacement of one image and, with a rig, the surface that made it.

        Parameters
        ----------
        image : Path or (rows, cols) array
            The image.

        Returns
        -------
        StillReading
            What was measured.
        """
        name = image.stem if isinstance(image, Path) else "image"
        image = self.load(image)
        displacement = correlate(self.reference, image, guess=self._before, **self._options)
        if not displacement.valid.any():
            return StillReading(name, displacement)
        self._before = displacement
        if self._rig is None:
            return StillReading(name, displacement)
        warp = measured_warp(displacement, self._optics, self._grid)
        if not warp.valid.any():
            return StillReading(name, displacement, grid=self._grid, calibrated=self.calibrated)
        surface, summit = self._read(warp, displacement.noise_grey / np.sqrt(2.0))
        return StillReading(name, displacement, surface, summit, self._grid, self.calibrated)

    def _read(self, warp: Warp, noise_grey: float) -> tuple[Surface, Peak | None]:
        """Surface and peak of a warp, with what its bends may have done to it in sigma."""
        assert self._rig is not None
        rest = self._optics.rest_map(*self._grid.mesh())
        half_speck_px2 = 0.25 * speck_px2(self.reference, noise_grey)
        spread_px2 = self._rig.camera.psf_px**2 + 1.0 / 12.0 + half_speck_px2
        other = self._reader.read(blurred(warp, rest, self._grid.spacing_px, spread_px2))
        its = peak(other)
        surface = self._reader.read(warp)
        return with_bend(surface, peak(surface), other, its)


def _grey(image: Path | Image, name: str) -> tuple[Image, str]:
    """Grey levels (rows, cols) of a file or an array, and what messages call it."""
    if isinstance(image, Path):
        return read_grey(image), str(image)
    if getattr(image, "ndim", None) != 2 or image.dtype not in (np.uint8, np.uint16):
        found = f"{getattr(image, 'dtype', type(image).__name__)} {getattr(image, 'shape', '')}".strip()
        raise InputError(f"{name}: {found}: (rows, cols) grey levels of 8 or 16 bits, or an image file")
    return image, name


def measure(
    reference: str | Path | Image,
    image: str | Path | Image,
    rig: Rig | str | Path | None = None,
    *,
    spacing_px: int | None = None,
    window_px: float | None = None,
    largest_shift_px: float | None = None,
) -> StillReading:
    """Measure how one still image moved against another: reference(u, v) = image(u + du, v + dv).

    Any texture will do. `Measurement` measures sequences, each image from the one before.

    Parameters
    ----------
    reference, image : str, Path or (rows, cols) array
        Image files or grey levels, 8 or 16 bits; with a rig, the reference is the mirror at rest.
    rig : Rig, str or Path, optional
        Bench whose camera took the images, as for `Session`; with it, slope and depth are read as well. Depth
        is relative where its geometry is neither calibrated nor declared exact.
    spacing_px : int, optional
        Pixels between the points.
    window_px : float, optional
        Standard deviation of the Gaussian window; by default chosen for each point.
    largest_shift_px : float, optional
        How far any point may have moved; decides by how many periods a texture that repeats did.

    Returns
    -------
    StillReading
        Displacement and, with a rig, surface and peak.

    Raises
    ------
    InputError
        For what is no image, and for images whose sizes differ or that are not of the rig's camera.
    MeasurementError
        For a rig that is not calibrated and sees too little of the mirror to state what is open of depth.
    """
    bench = load_rig(rig) if isinstance(rig, str | Path) else rig
    if bench is not None:
        check_geometry(bench)
    first, second = (Path(one) if isinstance(one, str) else one for one in (reference, image))
    spacing = SPACING_PX if spacing_px is None else spacing_px
    return Measurement(
        first, rig=bench, spacing_px=spacing, window_px=window_px, largest_shift_px=largest_shift_px
    ).measure(second)


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
        "doubt": commonest(found.doubts),
        "displacement_median_px": float(np.median(length)),
        "displacement_largest_px": float(length.max()),
        "sigma_median_px": float(np.median(sigma)),
        "noise_grey": found.noise_grey,
    }
    if reading.grid is not None:
        out["depth_peak_mm"] = reading.peak.depth_mm if reading.peak else float("nan")
        out["depth_peak_sigma_mm"] = reading.peak.sigma_mm if reading.peak else float("nan")
    return out


def commonest(doubts: Bytes) -> str:
    """Name of the reason that most points have against them, in small letters; empty where none has."""
    counts = {doubt: int(np.count_nonzero(doubts & doubt)) for doubt in PointFlag}
    most = max(counts, key=lambda doubt: counts[doubt])
    return str(most.name).lower() if counts[most] else ""


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
        out["calibrated"] = np.array(reading.calibrated)
    return out


def _size(image: Image | tuple[int, ...]) -> str:
    rows, cols = image.shape if isinstance(image, np.ndarray) else image
    return f"{cols} x {rows} px"
