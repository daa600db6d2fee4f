"""A camera calibrated by itself: focal length, principal point and distortion from views of a board.

Z. Zhang, IEEE Trans. PAMI 22 (2000) 1330, doi:10.1109/34.888718, as OpenCV does it; the covariance is made
here, in full. Of the lens models, which hold ever more terms of distortion, the simplest is taken that the
corners do not contradict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float
from zeromethod.calibration.charuco import LEAST_CORNERS, Board, View
from zeromethod.calibration.observations import INTRINSICS, Intrinsics
from zeromethod.errors import InputError, MeasurementError

LEAST_VIEWS = 4
MOST_RMS_PX = 2.0
"""Misfit from which the corners are not those of the board."""

LOOSE_FOCAL_SHARE = 0.05
"""Sigma of the focal length over it, from which nothing was learnt."""

_TERMS = (("k1",), ("k1", "k2"), ("k1", "k2", "p1", "p2"), ("k1", "k2", "p1", "p2", "k3"))
_TELLING = 25.0
"""Fall of chi-squared per new term from which the corners ask for it: five sigma."""
_STRAY, _STRAY_ROUNDS = 6.0, 8
_LEAST_STRAY_PX = 0.5
_RMS_FLOOR_PX = 1e-6


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
    solution = _solve(views, board, shape)
    kept = list(views)
    for _ in range(_STRAY_ROUNDS):
        fewer = _without_strayest(kept, solution)
        if fewer is None:
            break
        kept, solution = fewer, _solve(fewer, board, shape)
    stray = sum(len(view.ids) for view in views) - sum(len(view.ids) for view in kept)
    if solution.rms_px > MOST_RMS_PX:
        raise InputError(
            f"--board: the corners do not lie as on {board}: {solution.rms_px:.1f} px off: another board, or "
            "pictures that are all alike?"
        )
    covariance = _covariance(solution, len(kept))
    focal, sigma = float(solution.values[0]), float(np.sqrt(covariance[0, 0]))
    if not sigma < LOOSE_FOCAL_SHARE * focal:
        raise MeasurementError(
            f"intrinsics: the focal length stays open by {sigma / focal:.0%}: tilt the board by 20 to 40 "
            "degrees, another way in each picture"
        )
    names = (*INTRINSICS[:4], *solution.terms)
    return CameraFit(
        Intrinsics(names, solution.values, covariance),
        solution.rms_px,
        tuple(view.name for view in kept),
        sum(len(view.ids) for view in kept),
        stray,
        shape,
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    """One lens model solved.

    values: (4 + terms,) fx, fy, cx, cy and the terms. residual: (n, 2) px of every view. jacobian: of the
    corners by pose and values, (2 n, 6 + values) of every view.
    """

    terms: tuple[str, ...]
    values: Float
    residual: list[Float]
    jacobian: list[Float]

    @property
    def squares(self) -> float:
        return float(sum((one**2).sum() for one in self.residual))

    @property
    def freedom(self) -> int:
        """Numbers less what was fitted to them."""
        numbers = sum(one.size for one in self.residual)
        return max(numbers - 6 * len(self.residual) - len(self.values), 1)

    @property
    def rms_px(self) -> float:
        return max(float(np.sqrt(self.squares / self.freedom)), _RMS_FLOOR_PX)


def _solve(views: Sequence[View], board: Board, shape: tuple[int, int]) -> _Solution:
    """Solve with the simplest lens that suffices."""
    best: _Solution | None = None
    for terms in _TERMS:
        found = _solved(views, board, shape, terms)
        if best is not None:
            more = len(terms) - len(best.terms)
            if not best.squares - found.squares > _TELLING * more * found.rms_px**2:
                continue
        best = found
    assert best is not None
    return best


def _solved(views: Sequence[View], board: Board, shape: tuple[int, int], terms: tuple[str, ...]) -> _Solution:
    points = [board.points_mm(view.ids).astype(np.float32) for view in views]
    pixels = [view.pixel.astype(np.float32) for view in views]
    flags = 0
    for term, fixed in (
        ("k2", cv2.CALIB_FIX_K2),
        ("p1", cv2.CALIB_ZERO_TANGENT_DIST),
        ("k3", cv2.CALIB_FIX_K3),
    ):
        flags |= 0 if term in terms else fixed
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    try:
        _, matrix, lens, rotations, shifts = cv2.calibrateCamera(
            points, pixels, (shape[1], shape[0]), np.eye(3), np.zeros(5), flags=flags, criteria=criteria
        )
    except cv2.error as error:
        words = " ".join(str(error.err).split()) or "no solution"
        raise InputError(
            f"intrinsics: the views give no camera ({words}): the board in other poses"
        ) from None
    lens = np.asarray(lens, np.float64).ravel()[:5]
    columns = [*range(6), *range(6, 10), *(10 + INTRINSICS.index(term) - 4 for term in terms)]
    residual: list[Float] = []
    jacobians: list[Float] = []
    for view, rotation, shift in zip(views, rotations, shifts, strict=True):
        seen, by = cv2.projectPoints(board.points_mm(view.ids), rotation, shift, matrix, lens)
        residual.append(np.asarray(seen, np.float64).reshape(-1, 2) - view.pixel)
        jacobians.append(np.asarray(by, np.float64)[:, columns])
    values = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
    given = dict(zip(INTRINSICS[4:], lens, strict=True))
    return _Solution(terms, np.append(values, [given[term] for term in terms]), residual, jacobians)


def _without_strayest(views: Sequence[View], solution: _Solution) -> list[View] | None:
    """The views less their worst corner where that lies far off what the rest says; None where none does.

    One a round, as a stray corner draws its whole view after it.
    """
    away = [np.hypot(*one.T) for one in solution.residual]
    limit = max(_STRAY * float(np.median(np.concatenate(away))), _LEAST_STRAY_PX)
    if max(float(one.max()) for one in away) < limit:
        return None
    kept = []
    for view, distance in zip(views, away, strict=True):
        near = (distance < limit) | (distance < distance.max())
        if np.count_nonzero(near) >= LEAST_CORNERS:
            kept.append(View(view.name, view.ids[near], view.pixel[near]))
    return kept if len(kept) >= LEAST_VIEWS else None


def _covariance(solution: _Solution, views: int) -> Float:
    """Covariance (n, n) of the values, every view's pose left open.

    Each view's normal equations are freed of its pose (Schur's complement). What leaving out one view after
    the other would change (the jackknife, to first order) tells how views scatter one against another.
    """
    parts = []
    for residual, jacobian in zip(solution.residual, solution.jacobian, strict=True):
        pose, inner = jacobian[:, :6], jacobian[:, 6:]
        freed = inner - pose @ np.linalg.lstsq(pose, inner, rcond=None)[0]
        parts.append((freed.T @ freed, freed.T @ residual.ravel()))
    normal = np.sum([one for one, _ in parts], axis=0)
    scale = np.sqrt(np.diag(normal))
    normal = normal / np.outer(scale, scale)
    plain = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
    between = np.zeros(len(scale))
    for one, gradient in parts:
        without = np.linalg.pinv(normal - one / np.outer(scale, scale), rcond=1e-14, hermitian=True)
        between += (views - 1) / views * (without @ (gradient / scale)) ** 2
    factor = float(np.median(between / np.diag(plain))) / solution.rms_px**2
    return np.asarray(plain * max(factor, 1.0) * solution.rms_px**2 / np.outer(scale, scale))
