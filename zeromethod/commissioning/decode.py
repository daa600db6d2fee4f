"""The rest map from frames on disk: images, multi-page TIFF, .npy and .npz, one set of shifts at a time."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zeromethod.arrays import Image
from zeromethod.decoding.decoding import frames_expected
from zeromethod.decoding.fringes import Axis, FringeSequence, equal_shifts
from zeromethod.decoding.measuring import LIMIT_SHARE, RestMeasurement, measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.errors import InputError, MeasurementError
from zeromethod.passive.measure import read_grey
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.warp.rest_map import Reason, plain_name

_FEW = 0.001
"""Share of the view below which what shows fringes is not worth a word."""

_FILES = "an image of 8 or 16 bits (png, tif, ...), or grey levels in .npy or .npz"


@dataclass(frozen=True, slots=True)
class _File:
    """One file of one or more frames; `frames` reads them, one after the other."""

    path: Path
    count: int
    frames: Callable[[], Iterator[Image]]


def _planes(path: Path, arrays: Sequence[Image]) -> int:
    """Frames in arrays of (rows, cols) or (frames, rows, cols)."""
    for array in arrays:
        if array.ndim not in (2, 3) or array.dtype.kind not in "uif" or array.size == 0:
            raise InputError(
                f"{path}: {array.dtype} {array.shape}: (rows, cols) or (frames, rows, cols) grey"
            )
    return sum(1 if array.ndim == 2 else len(array) for array in arrays)


def _split(arrays: Sequence[Image]) -> Iterator[Image]:
    for array in arrays:
        yield from (array[None] if array.ndim == 2 else array)


def _open(path: Path) -> _File:
    """How many frames a file holds. Raises InputError for what is missing or cannot be read."""
    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        try:
            if suffix == ".npy":
                arrays = [np.load(path, mmap_mode="r", allow_pickle=False)]
            else:
                with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
                    arrays = list(data.values())
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or 'damaged'}): {_FILES}") from error
        except (ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: damaged, or not numbers: {_FILES}") from error
        return _File(path, _planes(path, arrays), lambda: _split(arrays))
    if suffix in (".tif", ".tiff"):
        try:
            pages = cv2.imcount(str(path)) if path.is_file() else 0
        except cv2.error:
            pages = 0
        if pages > 1:
            return _File(path, pages, lambda: _pages(path))
    if not path.is_file():
        raise InputError(f"{path}: {'a folder' if path.is_dir() else 'no such file'}: {_FILES}")
    return _File(path, 1, lambda: iter([read_grey(path)]))


def _pages(path: Path) -> Iterator[Image]:
    done, pages = cv2.imreadmulti(str(path), flags=cv2.IMREAD_UNCHANGED)
    if not done or any(page.ndim != 2 for page in pages):
        raise InputError(f"{path}: pages that are no grey images: {_FILES}")
    yield from pages


@dataclass(frozen=True)
class FrameFiles:
    """Frames of a fringe sequence on disk, in the order of their names on the command line."""

    files: tuple[_File, ...]

    @classmethod
    def of(cls, paths: Sequence[Path], sequence: FringeSequence) -> FrameFiles:
        """Count the frames. Raises InputError for unreadable files or a number that does not fit."""
        files = tuple(_open(path) for path in paths)
        count = sum(file.count for file in files)
        if count != sequence.frames:
            raise InputError(f"FRAMES: {count} in {len(files)} files: {frames_expected(sequence)}")
        return cls(files)

    def __iter__(self) -> Iterator[Image]:
        """Every frame, read when it is asked for; InputError names the file whose size is another."""
        shape: tuple[int, ...] | None = None
        for file in self.files:
            for frame in file.frames():
                shape = shape or frame.shape
                if frame.shape != shape:
                    raise InputError(
                        f"{file.path}: {frame.shape[1]} x {frame.shape[0]} px: "
                        f"the first frame has {shape[1]} x {shape[0]}"
                    )
                yield frame

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the first frame."""
        rows, cols = next(iter(self)).shape
        return rows, cols


def decode_files(
    paths: Sequence[Path],
    sequence: FringeSequence,
    *,
    size_px: tuple[int, int] | None = None,
    noise: NoiseModel | None = None,
    bits: int | None = None,
    limit_share: float = LIMIT_SHARE,
    camera_shape: tuple[int, int] | None = None,
    advance: Callable[[], None] | None = None,
) -> RestMeasurement:
    """Rest map from files; see `measure_rest`. camera_shape: (rows, cols) that the frames must have.

    advance is called after every frame that was read.
    """
    frames = FrameFiles.of(paths, sequence)
    if camera_shape is not None and frames.shape != camera_shape:
        rows, cols = frames.shape
        raise InputError(
            f"{paths[0]}: {cols} x {rows} px: the rig's camera has {camera_shape[1]} x {camera_shape[0]}"
        )

    def checked() -> Iterator[Image]:
        for frame in frames:
            if bits is not None and frame.max() >= 2**bits:
                raise InputError(f"FRAMES: a grey level of {frame.max()}: more than {bits} bits hold")
            yield frame
            if advance is not None:
                advance()

    return measure_rest(
        checked(),
        sequence,
        size_px=size_px,
        noise=noise,
        ceiling_grey=float(2**bits - 1) if bits else None,
        limit_share=limit_share,
    )


def decode(
    frames: Sequence[str | Path],
    periods_px: Sequence[float] | tuple[Sequence[float], Sequence[float]],
    shifts: int | Sequence[float],
    *,
    rig: Rig | str | Path | None = None,
    panel_px: tuple[int, int] | None = None,
    axes: tuple[Axis, Axis] = ("columns", "rows"),
    repeats: int = 1,
    bits: int | None = None,
    noise: NoiseModel | None = None,
    second_reflection: float = LIMIT_SHARE,
) -> RestMeasurement:
    """Absolute LCD position of every camera pixel, from pictures of shifted fringes.

    Parameters
    ----------
    frames : sequence of str or Path
        Files in the order in which they were shown: for each repeat, each axis, each period, each shift.
    periods_px : sequence of float, or two of them
        Periods of the fringes, LCD px; those along the columns, then those along the rows, where they differ.
    shifts : int or sequence of float
        Number of equal shifts, or the shifts in rad.
    rig : Rig, str or Path, optional
        Gives the LCD's size, the camera's size, bits and noise.
    panel_px : (int, int), optional
        LCD columns and rows; by default the rig's, else as far as the periods reach.
    axes : {("columns", "rows"), ("rows", "columns")}
        Which axis was shown first.
    repeats : int
        How often the whole sequence was shown.
    bits : int, optional
        Bits of the camera; all set is saturated.
    noise : NoiseModel, optional
        Of the camera; by default the rig's, else found in the frames.
    second_reflection : float
        Largest second reflection to accept, of the main one's light.

    Returns
    -------
    RestMeasurement
        The rest map (`rest_map`) with a reason for every pixel that has no position.

    Raises
    ------
    InputError
        For files that cannot be read, or that do not fit the sequence or the rig.

    Notes
    -----
    light = 1/2 + 1/2 cos(2 pi x / period - shift), with x the LCD column or row.
    """
    bench = rig if isinstance(rig, Rig) or rig is None else load_rig(rig)
    angles = equal_shifts(shifts) if isinstance(shifts, int) else tuple(map(float, shifts))
    each = periods_px if np.ndim(periods_px[0]) else [periods_px]
    columns, *rows = (tuple(map(float, periods)) for periods in each)  # type: ignore[arg-type]
    size, shape = panel_px, None
    if bench is not None:
        size = panel_px or (bench.display.columns, bench.display.rows)
        shape = bench.camera.rows, bench.camera.columns
    return decode_files(
        [Path(path) for path in frames],
        FringeSequence(columns, angles, axes, repeats, *rows),
        size_px=size,
        noise=noise or noise_of(bench),
        bits=bits or (bench.camera.bits if bench else None),
        limit_share=second_reflection,
        camera_shape=shape,
    )


def noise_of(rig: Rig | None) -> NoiseModel | None:
    """Noise of a rig's camera, as decoding takes it; None where it is not known."""
    if rig is None or (rig.camera.noise.read_grey == 0 and rig.camera.noise.electrons_per_grey is None):
        return None
    noise = rig.camera.noise
    return NoiseModel.of_camera(noise.read_grey, noise.electrons_per_grey, noise.black_grey)


def figures(found: RestMeasurement) -> dict[str, Any]:
    """Figures of a rest map, as the table and the summary give them; NaN where not known."""
    rest = found.rest_map
    valid = rest.valid
    some = bool(valid.any())
    sigma = rest.sigma_px[valid] if some else np.full((1, 2), np.nan)
    return {
        "valid_share": float(valid.mean()),
        "sigma_column_median_px": float(np.median(sigma[:, 0])),
        "sigma_row_median_px": float(np.median(sigma[:, 1])),
        "phase_sigma_rad": found.phase_sigma_rad,
        "wrong_orders_expected": found.order_error,
        "display_px": list(found.size_px),
        "noise_constant_grey2": found.noise.constant_grey2,
        "noise_slope_grey": found.noise.slope_grey,
        "noise_from": "scatter" if found.noise_found else "camera",
        "scatter_over_noise": found.scatter_ratio,
        "second_harmonic_share": found.second_harmonic,
        "folded_harmonic_share": found.folded_harmonic,
        "light_drift_share": found.light_drift,
        "light_flicker_share": found.flicker,
        "near_reflection_px": found.near_px,
        "second_reflection_median_share": float(np.median(found.reflection[valid])) if some else float("nan"),
        "reasons_px": {plain_name(reason): found.count(reason) for reason in Reason},
    }


_MEANING = {
    Reason.NO_MODULATION: "no modulation",
    Reason.SECOND_REFLECTION: (
        "the periods disagree (other periods than given, a mirror that moved, or a second reflection)"
    ),
    Reason.INCONSISTENT: "the periods disagree",
    Reason.DISTURBED: "the light changed between or within the sets of shifts",
    Reason.WRONG_ORDER: "places lie whole periods off their neighbours",
}


def refuse_empty(found: RestMeasurement) -> None:
    """Raise MeasurementError with the reason that holds against most pixels when not one is valid.

    Pixels without fringes are dark or no mirror; where there are others, their reasons say what is wrong.
    """
    if found.rest_map.valid.any():
        return
    reason = found.rest_map.reason
    fringed = reason != int(Reason.NO_MODULATION)
    if np.count_nonzero(fringed) < _FEW * fringed.size:
        fringed[:] = True
    count = {why: np.count_nonzero(reason[fringed] & int(why)) for why in Reason}
    worst = max(count, key=lambda why: count[why])
    share = count[worst] / np.count_nonzero(fringed)
    why = (
        f"{_MEANING.get(worst, plain_name(worst))} at {share:.0%}" if share > 0 else "nothing is known of any"
    )
    of = " of those with fringes" if share > 0 and not fringed.all() else ""
    raise MeasurementError(f"no camera pixel has a place on the LCD: {why}{of}")
