"""Pictures of a ChArUco board as a known camera takes them."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.calibration.charuco import Board
from zeromethod.optics.camera import undistort

SHAPE = (384, 512)
FOCAL_PX = (1800.0, 1805.0)
CENTRE_PX = (262.0, 187.0)
DISTORTION = (-0.25, 0.0, 0.0, 0.0, 0.0)
BOARD = Board(9, 7, 8.0, 6.0)
SQUARE_PX, FINER = 48, 2
NOISE_GREY = 2.0

POSES_DEG = (
    (30, 0, 0), (-30, 5, 10), (0, 30, 0), (5, -30, 20), (25, 25, 90), (-20, 25, 45), (22, -24, 180),
    (-24, -22, -30), (12, 35, 0), (-35, 10, 5),
)  # fmt: skip
"""How the board is tilted about the camera's u and v, and turned, picture by picture."""


@cache
def _rays(distortion: tuple[float, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions x / z and y / z of the camera's rays, `FINER` to the pixel."""
    rows, columns = SHAPE
    v, u = (np.mgrid[: rows * FINER, : columns * FINER] + 0.5) / FINER - 0.5
    return undistort((u - CENTRE_PX[0]) / FOCAL_PX[0], (v - CENTRE_PX[1]) / FOCAL_PX[1], distortion)


def seen(
    pose_deg: tuple[float, float, float],
    rng: np.random.Generator,
    board: Board = BOARD,
    distortion: tuple[float, float, float, float, float] = DISTORTION,
    away_mm: float = 290.0,
) -> NDArray[np.uint8]:
    """Picture of the board, its middle near the axis, `away_mm` from the camera."""
    (rows, columns), (x, y) = SHAPE, _rays(distortion)
    about_u, about_v, turn = np.radians(pose_deg)
    rotation = (
        cv2.Rodrigues(np.array([about_u, 0.0, 0.0]))[0]
        @ cv2.Rodrigues(np.array([0.0, about_v, 0.0]))[0]
        @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    )
    middle = np.array([*rng.uniform(-4.0, 4.0, 2), away_mm * rng.uniform(0.9, 1.1)])
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    reach = (rotation[:, 2] @ middle) / (ray @ rotation[:, 2])
    place = (reach[..., None] * ray - middle) @ rotation[:, :2]
    size_mm = board.square_mm * np.array([board.columns, board.rows])
    # the picture's margin is half a square; its px are centred at integers
    at = (place + size_mm / 2 + board.square_mm / 2) * (SQUARE_PX / board.square_mm) - 0.5
    picture = board.picture(SQUARE_PX)
    fine = cv2.remap(
        picture,
        at[..., 0].astype(np.float32),
        at[..., 1].astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=255,
    )
    light = fine.reshape(rows, FINER, columns, FINER).mean(axis=(1, 3))
    grey = 20.0 + 0.7 * light + NOISE_GREY * rng.standard_normal(SHAPE)
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)
