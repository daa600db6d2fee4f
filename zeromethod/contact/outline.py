"""A contact's border to a fraction of a pixel: where the grey levels across it are most likely."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d

from zeromethod.arrays import Bytes, Float, Mask, Single
from zeromethod.contact.likelihood import REACH_PX, STEP_PX, GreyModel

_ACROSS = 8
"""Pixels on either side of the border that are looked at."""
_WAY = 12
"""Steps of STEP_PX by which a border may move at once."""
_PASSES = 2
_APART_PX = 2.0
_ALONG_PX = 5.0
"""Standard deviation, along the border, of the window in which it moves as one: a third of a period."""
WINDOW_PX = 18.0
"""Length of border that moves as one: 2 sqrt(pi) times that deviation."""
_SMOOTH_PX = 3.0
_ALIKE = 16.0
"""Pixels that say one thing: what the model takes for chance is one carrier's phase. Borders of made-up discs
scatter as that has it."""


@dataclass(frozen=True, slots=True)
class Outline:
    """points_px: (n, 2) (u, v), anticlockwise as x runs to y. sigma_px: of each point across the border."""

    points_px: Float
    sigma_px: float


def first_outline(mask: Mask) -> Float:
    """(n, 2) border of a region of a mask, its steps smoothed."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(contours, key=len)[:, 0, :].astype(np.float64)
    if signed_area(longest) < 0:
        longest = longest[::-1]
    return _smooth(resampled(longest), 2.0 / _APART_PX)


def resampled(points: Float) -> Float:
    """The closed polygon with points about _APART_PX apart."""
    return evenly(points, max(16, round(perimeter(points) / _APART_PX)))


def perimeter(points: Float) -> float:
    """Length of a closed polygon (n, 2)."""
    return float(np.hypot(*(points - np.roll(points, 1, axis=0)).T).sum())


def closed(points: Float) -> Float:
    """A polygon (n, 2) with its first point again at the end, (n + 1, 2)."""
    return np.concatenate((points, points[:1]))


def evenly(points: Float, count: int) -> Float:
    """`count` points (count, 2) evenly along a closed polygon (n, 2), from its first on."""
    line = closed(points)
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    at = np.arange(count) * (way[-1] / count)
    return np.stack([np.interp(at, way, line[:, k]) for k in (0, 1)], axis=-1)


def signed_area(points: Float) -> float:
    """Area of a closed polygon, > 0 where it runs from the first coordinate to the second."""
    x, y = points.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def normals(points: Float) -> Float:
    """(n, 2) unit vectors out of a closed polygon of positive area."""
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return np.stack((along[:, 1], -along[:, 0]), axis=-1)


def refined(points: Float, columns: Bytes, model: GreyModel) -> Outline:
    """The border at its most likely place. columns: (rows, cols) `GreyModel.index` of the picture."""
    sigma = np.inf
    for _ in range(_PASSES):
        out = normals(points)
        score = _scores(points, out, columns, model.table)
        score = gaussian_filter1d(score, _ALONG_PX / _APART_PX, axis=0, mode="wrap")
        way, sharpness = _highest(score)
        # of a window's points those of one carrier are alike
        alone = WINDOW_PX / _APART_PX / _ALIKE
        sigma = float(1 / np.sqrt(alone * max(np.median(sharpness), 1e-6)))
        way = gaussian_filter1d(way, _SMOOTH_PX / _APART_PX, mode="wrap")
        points = _smooth(resampled(points + way[:, None] * out), 1.0 / _APART_PX)
    return Outline(points, min(sigma, 1.0))


def _smooth(points: Float, sigma_px: float) -> Float:
    return np.asarray(gaussian_filter1d(points, sigma_px, axis=0, mode="wrap"))


def _highest(score: Float) -> tuple[Float, Float]:
    """(place px, second derivative, sign turned, 1/px^2) of each row's highest point."""
    rows = np.arange(len(score))
    best = np.clip(np.argmax(score, axis=1), 1, score.shape[1] - 2)
    before, here, after = (score[rows, best + k] for k in (-1, 0, 1))
    bend = np.maximum(2 * here - before - after, 1e-9)
    off = np.clip(0.5 * (after - before) / bend, -1, 1)
    return STEP_PX * (best - _WAY + off), bend / STEP_PX**2


@numba.njit(cache=True, nogil=True)
def _scores(points: Float, out: Float, columns: Bytes, table: Single) -> Float:
    """(n, 2 _WAY + 1) log-likelihood of the grey levels about the border, moved along its normals."""
    rows, cols = columns.shape
    count, middle = len(points), int(REACH_PX / STEP_PX)
    score = np.zeros((count, 2 * _WAY + 1))
    for i in range(count):
        for k in range(-_ACROSS, _ACROSS + 1):
            u = int(np.rint(points[i, 0] + k * out[i, 0]))
            v = int(np.rint(points[i, 1] + k * out[i, 1]))
            if not (0 <= u < cols and 0 <= v < rows):
                continue
            # where the pixel truly lies across the border
            at = (u - points[i, 0]) * out[i, 0] + (v - points[i, 1]) * out[i, 1]
            grey = columns[v, u]
            for w in range(2 * _WAY + 1):
                place = int(np.rint(at / STEP_PX)) - (w - _WAY) + middle
                score[i, w] += table[min(max(place, 0), 2 * middle), grey]
    return score


def compile_ahead() -> None:
    """Have the compiled function ready before the first contact."""
    table = np.zeros((2 * int(REACH_PX / STEP_PX) + 1, 1), np.float32)
    _scores(np.zeros((1, 2)), np.ones((1, 2)), np.zeros((1, 1), np.uint8), table)
