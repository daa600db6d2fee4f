"""A camera calibrated by itself, as a file: by `zeromethod calibrate intrinsics`, OpenCV or ROS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomlkit

from zeromethod.arrays import Float
from zeromethod.atomic_write import atomic_write
from zeromethod.calibration.folder import read_document
from zeromethod.calibration.intrinsics import CameraFit
from zeromethod.calibration.measurements import INTRINSICS, Intrinsics
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.toml_file import read_text

ASSUMED_PERCENT = 0.5
"""Sigma of a camera whose file states none, of the focal length, unless the user gives another."""

_ASPECT_SHARE = 0.1
"""Sigma of one focal length against the other, over that of both together, as pixels are nearly square."""

_HEAD = "A camera, by `zeromethod calibrate intrinsics`; for `zeromethod calibrate --intrinsics`."
_ALLOWED = "a file by zeromethod calibrate intrinsics, or OpenCV's or ROS's camera calibration (.yaml)"
_MOST_BRACKETS = 1000
"""In a .yaml. A camera has a dozen; at some 30,000 inside each other OpenCV's reader ends the program."""

_SUFFIXES = (".yaml", ".yml")
_MODELS = ("", "plumb_bob", "rational_polynomial")
"""Distortion models of ROS whose first five terms are OpenCV's."""


@dataclass(frozen=True, eq=False)
class CameraFile:
    """What a file says. shape: (rows, columns) of the camera's pictures.

    states_no_sigma: the sigmas are the user's or assumed; see `read_yaml`.
    """

    path: Path
    intrinsics: Intrinsics
    shape: tuple[int, int]
    states_no_sigma: bool = False

    def check(self, rig: Rig) -> None:
        """Raise InputError where a rig's camera cannot be this one."""
        rows, columns = self.shape
        if (rig.camera.rows, rig.camera.columns) != self.shape:
            raise InputError(
                f"--intrinsics: {self.path}: of pictures of {columns} x {rows} px: the rig's camera has "
                f"{rig.camera.columns} x {rig.camera.rows}"
            )
        self.intrinsics.prepared(rig)


def save_camera(path: Path, found: CameraFit, board: str) -> None:
    """Write a file, in one move."""
    one = found.intrinsics
    document = {
        "schema_version": 1,
        "columns": found.shape[1],
        "rows": found.shape[0],
        "board": board,
        "views": len(found.views),
        "corners": found.corners,
        "stray_corners": found.stray,
        "rms_px": found.rms_px,
        "names": list(one.names),
        "values": one.values.tolist(),
        "sigma": one.spread.tolist(),
        "correlation": tomlkit.item(one.correlation.tolist()).multiline(True),
    }
    with atomic_write(path) as part:
        part.write_text(f"# {_HEAD}\n{tomlkit.dumps(document)}", encoding="utf-8")


def load_camera(path: Path, sigma_percent: float | None = None) -> CameraFile:
    """Read a file; sigma_percent: see `read_yaml`. Raises InputError for anything else."""
    if path.suffix.lower() in _SUFFIXES:
        return read_yaml(path, sigma_percent)
    try:
        document = read_document(path, _ALLOWED)
    except InputError as error:
        raise InputError(f"--intrinsics: {error}") from None
    if sigma_percent is not None:
        raise InputError(f"--intrinsics-sigma: {path} states its sigmas: only for files without them (.yaml)")
    try:
        names = [str(name) for name in document["names"]]
        numbers = [np.array(document[key], dtype=np.float64) for key in ("values", "sigma", "correlation")]
        return CameraFile(
            path, Intrinsics.of(names, *numbers), (int(document["rows"]), int(document["columns"]))
        )
    except InputError as error:
        raise InputError(f"--intrinsics: {path}: {error}") from None
    except (KeyError, TypeError, ValueError):
        raise InputError(f"--intrinsics: {path}: not complete: {_ALLOWED}") from None


def read_yaml(path: Path, sigma_percent: float | None = None) -> CameraFile:
    """Read OpenCV's YAML (camera_matrix, distortion_coefficients) or ROS's camera_info.

    Neither states sigmas. `sigma_percent` is the standard deviation of fx and fy together (one against the
    other: a tenth of it), of cx and cy in percent of the focal length, and of what each term of distortion
    does at the image's corner in percent of its distance from the centre. Terms of 0 are taken as exact.
    """
    try:
        text = read_text(path, _ALLOWED)
    except InputError as error:
        raise InputError(f"--intrinsics: {error}") from None
    if text.count("[") + text.count("{") > _MOST_BRACKETS:
        raise InputError(f"--intrinsics: {path}: more than {_MOST_BRACKETS} brackets: {_ALLOWED}")
    try:
        # ROS leaves out the header that OpenCV asks for
        head = "" if text.startswith("%YAML") else "%YAML:1.0\n---\n"
        file = cv2.FileStorage(head + text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        matrix, lens = (_numbers(file, key) for key in ("camera_matrix", "distortion_coefficients"))
        columns, rows = (int(file.getNode(key).real()) for key in ("image_width", "image_height"))
    except (cv2.error, SystemError):
        raise InputError(f"--intrinsics: {path}: not readable as YAML: {_ALLOWED}") from None
    if len(matrix) != 9 or len(lens) < 4 or min(rows, columns) < 1 or not np.isfinite([*matrix, *lens]).all():
        raise InputError(f"--intrinsics: {path}: not complete: {_ALLOWED}")
    if file.getNode("distortion_model").string() not in _MODELS or np.any(lens[5:]):
        raise InputError(
            f"--intrinsics: {path}: distortion other than k1, k2, p1, p2, k3: calibrate with these"
        )
    if min(matrix[0], matrix[4]) <= 0:
        raise InputError(f"--intrinsics: {path}: camera_matrix: focal lengths must be above 0")
    share = 1e-2 * (ASSUMED_PERCENT if sigma_percent is None else sigma_percent)
    focal = matrix[[0, 4]]
    terms = np.flatnonzero(lens[:5])
    reach = float(np.hypot(*(np.array([columns, rows]) / 2.0 / focal)))
    sigma = np.concatenate([focal, focal, reach ** -np.array([2.0, 4.0, 1.0, 1.0, 6.0])[terms]]) * share
    covariance = np.diag(sigma**2)
    covariance[:2, :2] = np.outer(sigma[:2], sigma[:2]) + _ASPECT_SHARE**2 * covariance[:2, :2]
    names = (*INTRINSICS[:4], *(INTRINSICS[4 + term] for term in terms))
    values = np.concatenate([focal, matrix[[2, 5]], lens[terms]])
    return CameraFile(path, Intrinsics(names, values, covariance), (rows, columns), True)


def _numbers(file: cv2.FileStorage, key: str) -> Float:
    """Numbers of a matrix; none where it is missing."""
    data = file.getNode(key).getNode("data")
    return np.array([data.at(index).real() for index in range(data.size())])
