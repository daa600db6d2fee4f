"""A camera calibrated by itself, as a file of its own (TOML)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from zeromethod.atomic_write import atomic_write
from zeromethod.calibration.intrinsics import CameraFit
from zeromethod.calibration.observations import Intrinsics
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig

SCHEMA_VERSION = 1
_HEAD = "A camera, by `zeromethod calibrate intrinsics`; for `zeromethod calibrate --intrinsics`."
_ALLOWED = "a file that zeromethod calibrate intrinsics wrote"
_DIGITS = 10


@dataclass(frozen=True, eq=False)
class CameraFile:
    """What a file says. shape: (rows, columns) of the camera's pictures."""

    path: Path
    intrinsics: Intrinsics
    shape: tuple[int, int]

    def check(self, rig: Rig) -> None:
        """Raise InputError where a rig's camera cannot be this one."""
        rows, columns = self.shape
        camera = rig.camera
        if (camera.rows, camera.columns) != self.shape:
            raise InputError(
                f"--intrinsics: {self.path}: of pictures of {columns} x {rows} px: the rig's camera has "
                f"{camera.columns} x {camera.rows}"
            )
        self.intrinsics.prepared(rig)


def save_camera(path: Path, found: CameraFit, board: str) -> None:
    """Write a file, in one move."""
    one = found.intrinsics
    sigma = np.sqrt(np.diag(one.covariance))
    correlation = one.covariance / np.outer(sigma, sigma)
    document = tomlkit.document()
    document.add(tomlkit.comment(_HEAD))
    document["schema_version"] = SCHEMA_VERSION
    document["columns"], document["rows"] = found.shape[1], found.shape[0]
    document["board"] = board
    document["views"], document["corners"], document["stray_corners"] = (
        len(found.views),
        found.corners,
        found.stray,
    )
    document["rms_px"] = _short(found.rms_px)
    document["names"] = list(one.names)
    document["values"] = [_short(value) for value in one.values]
    document["sigma"] = [_short(value) for value in sigma]
    rows = tomlkit.array()
    for row in correlation:
        rows.append([_short(value) for value in row])
    document["correlation"] = rows.multiline(True)
    with atomic_write(path) as part:
        part.write_text(tomlkit.dumps(document), encoding="utf-8")


def load_camera(path: Path) -> CameraFile:
    """Read a file. Raises InputError for anything else."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"--intrinsics: {path}: {error.strerror}: {_ALLOWED}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"--intrinsics: {path}: {error}: {_ALLOWED}") from None
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(f"--intrinsics: {path}: schema_version: {version!r}: {SCHEMA_VERSION}: {_ALLOWED}")
    try:
        names = [str(name) for name in document["names"]]
        values = np.array(document["values"], dtype=np.float64)
        sigma = np.array(document["sigma"], dtype=np.float64)
        correlation = np.array(document["correlation"], dtype=np.float64)
        shape = int(document["rows"]), int(document["columns"])
        covariance = correlation * np.outer(sigma, sigma)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"--intrinsics: {path}: not complete: {_ALLOWED}") from None
    size = len(names)
    if values.shape != (size,) or covariance.shape != (size, size) or not np.isfinite(covariance).all():
        raise InputError(f"--intrinsics: {path}: numbers that do not go together: {_ALLOWED}")
    try:
        return CameraFile(path, Intrinsics(names, values, covariance), shape)
    except InputError as error:
        raise InputError(f"--intrinsics: {path}: {error}") from None


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
