"""A camera calibrated by itself: focal length, principal point and distortion from views of a board.

Z. Zhang, IEEE Trans. PAMI 22 (2000) 1330, doi:10.1109/34.888718, as OpenCV does it. OpenCV gives each value's
sigma but not how they are correlated: the full covariance is made here. Of the lens models, which hold ever
more terms of distortion, the simplest is taken that the corners do not contradict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.charuco import LEAST_CORNERS, Board, View
from zeromethod.calibration.measurements import INTRINSICS, Intrinsics
from zeromethod.errors import InputError, MeasurementError

LEAST_VIEWS = 4
MOST_RMS_PX = 2.0
"""Misfit from which the corners are not those of the board."""

LOOSE_FOCAL_SHARE = 0.05
"""Sigma of the focal length over it, from which nothing was learnt."""

_MODELS = (1, 2, 4, 5)
"""Terms of distortion, in OpenCV's order, of ever richer lenses."""
_FIXED = {2: cv2.CALIB_FIX_K2, 4: cv2.CALIB_ZERO_TANGENT_DIST, 5: cv2.CALIB_FIX_K3}
"""What keeps the terms of a model at 0 in simpler ones."""
_FALL_PER_TERM = 25.0
"""Fall of chi-squared per new term from which the corners ask for it: five sigma."""
_STRAY, _STRAY_ROUNDS = 6.0, 8
_LEAST_STRAY_PX = 0.5
_RMS_FLOOR_PX = 1e-6
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12)


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A camera as calibrated.

    intrinsics: values and full covariance. rms_px: misfit of a corner's coordinate. views: that counted.
    corners: that counted; stray: that did not. shape: (rows, columns) of the pictures.
    """

    intrinsics: Intrinsics
    rms_px: float
    views: tuple[str, ...]
    corners: int
    stray: int
    shape: tuple[int, int]


def fit_camera(views: Sequence[View], board: Board, shape: tuple[int, int]) -> CameraFit:
    """Calibrate from views of `board` in pictures of `shape` (rows, columns).

    Corner errors are taken as the misfit shows them. What the corners of one picture share (the board not
    flat, blur) raises all sigmas together by what the pictures, one against another, show.

    Raises
    ------
    InputError
        Fewer than four views, or corners that are not this board's.
    MeasurementError
        All views so flat-on that the focal length stays open.
    """
    if len(views) < LEAST_VIEWS:
        raise InputError(f"intrinsics: {len(views)} pictures with the board: at least {LEAST_VIEWS}")
    kept, lens = list(views), _simplest_lens(views, board, shape)
    for _ in range(_STRAY_ROUNDS):
        fewer = _without_strayest(kept, lens)
        if fewer is None:
            break
        kept, lens = fewer, _simplest_lens(fewer, board, shape)
    if lens.rms_px > MOST_RMS_PX:
        raise InputError(
            f"--board: the corners do not lie as on {board}: {lens.rms_px:.1f} px off: another board, or "
            "pictures that are all alike?"
        )
    covariance = _covariance(lens)
    focal, sigma = float(lens.values[0]), float(np.sqrt(covariance[0, 0]))
    if not sigma < LOOSE_FOCAL_SHARE * focal:
        raise MeasurementError(
            f"intrinsics: the focal length stays open by {sigma / focal:.0%}: tilt the board by 20 to 40 "
            "degrees, another way in each picture"
        )
    corners = sum(len(view.ids) for view in kept)
    stray = sum(len(view.ids) for view in views) - corners
    intrinsics = Intrinsics(INTRINSICS[: len(lens.values)], lens.values, covariance)
    return CameraFit(intrinsics, lens.rms_px, tuple(view.name for view in kept), corners, stray, shape)


@dataclass(frozen=True, eq=False)
class _Lens:
    """One lens model solved.

    values: (4 + terms,) the first of `INTRINSICS`. residual: (n, 2) px of every view. jacobian: (2 n,
    6 + values) of the corners by pose and values, of every view.
    """

    values: Float
    residual: list[Float]
    jacobian: list[Float]

    @property
    def squares(self) -> float:
        return float(sum((one**2).sum() for one in self.residual))

    @property
    def rms_px(self) -> float:
        fitted = 6 * len(self.residual) + len(self.values)
        freedom = max(sum(one.size for one in self.residual) - fitted, 1)
        return max(float(np.sqrt(self.squares / freedom)), _RMS_FLOOR_PX)


def _simplest_lens(views: Sequence[View], board: Board, shape: tuple[int, int]) -> _Lens:
    """The simplest lens that suffices."""
    best = _solved(views, board, shape, _MODELS[0])
    for terms in _MODELS[1:]:
        found = _solved(views, board, shape, terms)
        more = len(found.values) - len(best.values)
        if best.squares - found.squares > _FALL_PER_TERM * more * found.rms_px**2:
            best = found
    return best


def _solved(views: Sequence[View], board: Board, shape: tuple[int, int], terms: int) -> _Lens:
    pairs = [board.cv.matchImagePoints(view.pixel.astype(np.float32), view.ids) for view in views]
    points, pixels = zip(*pairs, strict=True)
    flags = sum(flag for least, flag in _FIXED.items() if terms < least)
    try:
        _, matrix, lens, rotations, shifts = cv2.calibrateCamera(
            points, pixels, shape[::-1], np.eye(3), np.zeros(5), flags=flags, criteria=_CRITERIA
        )
    except cv2.error as error:
        words = " ".join(str(error.err).split()) or "no solution"
        raise InputError(
            f"intrinsics: the views give no camera ({words}): the board in other poses"
        ) from None
    lens = np.asarray(lens, np.float64).ravel()[:5]
    residual: list[Float] = []
    jacobian: list[Float] = []
    for view, place, rotation, shift in zip(views, points, rotations, shifts, strict=True):
        seen, by = cv2.projectPoints(place.astype(np.float64), rotation, shift, matrix, lens)
        residual.append(np.asarray(seen, np.float64).reshape(-1, 2) - view.pixel)
        jacobian.append(np.asarray(by, np.float64)[:, : 10 + terms])
    values = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *lens[:terms]])
    return _Lens(values, residual, jacobian)


def _without_strayest(views: Sequence[View], lens: _Lens) -> list[View] | None:
    """The views less their worst corner where that lies far off what the rest says; None where none does.

    One a round, as a stray corner draws its whole view after it.
    """
    away = [np.hypot(*one.T) for one in lens.residual]
    limit = max(_STRAY * float(np.median(np.concatenate(away))), _LEAST_STRAY_PX)
    if max(float(one.max()) for one in away) < limit:
        return None
    kept = []
    for view, distance in zip(views, away, strict=True):
        near = (distance < limit) | (distance < distance.max())
        if np.count_nonzero(near) >= LEAST_CORNERS:
            kept.append(View(view.name, view.ids[near], view.pixel[near]))
    return kept if len(kept) >= LEAST_VIEWS else None


def _covariance(lens: _Lens) -> Float:
    """Covariance (n, n) of the values, every view's pose left open.

    Each view's normal equations are freed of its pose (Schur's complement). What leaving out one view after
    the other would change (the jackknife, to first order) shows how views scatter one against another.
    """
    parts = []
    for residual, jacobian in zip(lens.residual, lens.jacobian, strict=True):
        pose, inner = jacobian[:, :6], jacobian[:, 6:]
        freed = inner - pose @ np.linalg.lstsq(pose, inner, rcond=None)[0]
        parts.append((freed.T @ freed, freed.T @ residual.ravel()))
    normal = np.sum([one for one, _ in parts], axis=0)
    scale = np.sqrt(np.diag(normal))
    units = np.outer(scale, scale)
    plain = np.linalg.pinv(normal / units, rcond=1e-14, hermitian=True)
    between = np.zeros(len(scale))
    for one, gradient in parts:
        without = np.linalg.pinv((normal - one) / units, rcond=1e-14, hermitian=True)
        between += (1.0 - 1.0 / len(parts)) * (without @ (gradient / scale)) ** 2
    variance = max(lens.rms_px**2, float(np.median(between / np.diag(plain))))
    return np.asarray(plain * variance / units)
