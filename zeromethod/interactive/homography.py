"""Homographies between places on the mirror and a projector's pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float
from zeromethod.rig.model import ProjectorSpec


def homography(from_points: ArrayLike, to_points: ArrayLike) -> Float:
    """(3, 3) homography that maps n >= 4 points (n, 2) to others with the least algebraic error."""
    both = [np.asarray(points, dtype=np.float64) for points in (from_points, to_points)]
    scaled, scales = zip(*(_scaled(points) for points in both), strict=True)
    (x, y), (u, v) = scaled[0].T, scaled[1].T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    # the eigenvector of the smallest eigenvalue: the normal equations are 9 x 9 for any number of points
    found = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3) if len(x) > 4 else _null(rows)
    whole = np.linalg.inv(scales[1]) @ found @ scales[0]
    return np.asarray(whole / whole[2, 2])


def mapped(by: Float, points: ArrayLike) -> Float:
    """Points (..., 2) mapped by a homography (3, 3)."""
    points = np.asarray(points, dtype=np.float64)
    sides = points @ by[:, :2].T + by[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(sides[..., :2] / sides[..., 2:])


def corners_px(projector: ProjectorSpec) -> Float:
    """(4, 2) the corner pixels (column, row), in the order of `corners_mm`."""
    last = projector.columns - 1, projector.rows - 1
    return np.array([(0, 0), (last[0], 0), (0, last[1]), last], dtype=np.float64)


def mm_to_px(projector: ProjectorSpec, off_mm: Sequence[Sequence[float]] | None = None) -> Float:
    """(3, 3) homography from the mirror, mm, to the picture's pixels. off_mm: (4, 2) added to the corners."""
    corners = np.array(projector.corners_mm) + (0.0 if off_mm is None else np.array(off_mm))
    return homography(corners, corners_px(projector))


def _null(rows: Float) -> Float:
    return np.asarray(np.linalg.svd(rows)[2][-1].reshape(3, 3))


def _scaled(points: Float) -> tuple[Float, Float]:
    """Points shifted to a mean of 0 and scaled to a mean |coordinate| of 1; the (3, 3) matrix of that."""
    middle = points.mean(axis=0)
    size = 1 / max(float(np.abs(points - middle).mean()), 1e-12)
    matrix = np.array([[size, 0, -size * middle[0]], [0, size, -size * middle[1]], [0, 0, 1]])
    return (points - middle) * size, matrix
