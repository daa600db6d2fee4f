"""A contact's border to a fraction of a pixel: where the grey levels across it are most likely.

Where on the whole it lies is said by the light across it: its mean over the border does not depend on what
the picture shows beside, as likelihoods do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from zeromethod.arrays import Bytes, Float, Mask, Single
from zeromethod.contact import polygon
from zeromethod.contact.likelihood import REACH_PX, STEP_PX, UNKNOWN, GreyModel
from zeromethod.contact.polygon import evenly, normals, perimeter, signed_area, smooth

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
_BALANCE_PX = 2.5
"""Distance from the border within which light is summed."""
_EVEN = 0.1
"""Share of the picture at which its phase and the camera's noise make light as uncertain as each other."""
_BALANCES = 2
_FARTHEST = 2.0
"""Standard deviations by which light may move a border: a shadow beside it is dark, whatever the phase."""


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
    return smooth(resampled(longest), 2.0 / _APART_PX)


def resampled(points: Float) -> Float:
    """The closed polygon with points about _APART_PX apart."""
    return evenly(points, max(16, round(perimeter(points) / _APART_PX)))


def refined(points: Float, columns: Bytes, model: GreyModel) -> Outline:
    """The border at its most likely place. columns: (rows, cols) `GreyModel.index` of the picture."""
    sigma = np.inf
    for _ in range(_PASSES):
        out = normals(points)
        score = smooth(_scores(points, out, columns, model.table), _ALONG_PX / _APART_PX)
        moved, sharpness = _highest(score)
        # of a window's points those of one carrier are alike
        alone = WINDOW_PX / _APART_PX / _ALIKE
        sigma = float(1 / np.sqrt(alone * max(sharpness, 1e-6)))
        way = smooth(moved, _SMOOTH_PX / _APART_PX)
        points = smooth(resampled(points + way * out), 1.0 / _APART_PX)
    sigma = min(sigma, 1.0)
    return Outline(_balanced(points, columns, model, sigma), sigma)


def _balanced(points: Float, columns: Bytes, model: GreyModel, sigma: float) -> Float:
    """The border moved as a whole to where the light across it is as its blur has it, on average."""
    around = perimeter(points)
    limit = _FARTHEST * sigma * min(math.sqrt(WINDOW_PX / around), 1.0)
    out, moved = normals(points), 0.0
    for _ in range(_BALANCES):
        # of a blurred border that bends outwards half of the light lies inside it
        bend = math.pi * model.blur_px**2 / around
        lacks = _lacking_light(
            points + moved * out, out, columns, bend, model.first, model.step, model.scattered,
            model.mirrored, model.blur_px,
        )  # fmt: skip
        moved = min(max(moved + lacks, -limit), limit)
    # a polygon's sides are chords
    chord = math.pi * (around / len(points)) ** 2 / (6 * around)
    return np.asarray(points + (moved + chord) * out)


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


@numba.njit(cache=True, nogil=True)
def _lacking_light(
    points: Float,
    out: Float,
    columns: Bytes,
    bend: float,
    first: float,
    step: float,
    scattered: float,
    mirrored: float,
    blur_px: float,
) -> float:
    """By how many px the border lies too far inside for the light across it."""
    rows, cols = columns.shape
    lacks, by_px = 0.0, 1e-9
    for i in range(len(points)):
        for k in range(-_ACROSS, _ACROSS + 1):
            u = int(np.rint(points[i, 0] + k * out[i, 0]))
            v = int(np.rint(points[i, 1] + k * out[i, 1]))
            if not (0 <= u < cols and 0 <= v < rows) or columns[v, u] == UNKNOWN:
                continue
            at = (u - points[i, 0]) * out[i, 0] + (v - points[i, 1]) * out[i, 1] + bend
            if abs(at) > _BALANCE_PX:
                continue
            share = 0.5 * (1 + math.erf(at / (math.sqrt(2.0) * blur_px)))
            per_px = math.exp(-0.5 * (at / blur_px) ** 2) / (math.sqrt(2 * math.pi) * blur_px)
            weight = per_px / (_EVEN + share)
            lacks += weight * (share - (first + step * columns[v, u] - scattered) / (mirrored - scattered))
            by_px += weight * per_px
    return lacks / by_px


@numba.njit(cache=True, nogil=True)
def _highest(score: Float) -> tuple[Float, float]:
    """(px (n, 1) of each row's highest point, median second derivative there, sign turned, 1/px^2)."""
    count, steps = score.shape
    place, sharpness = np.empty((count, 1)), np.empty(count)
    for i in range(count):
        best = min(max(int(np.argmax(score[i])), 1), steps - 2)
        before, here, after = score[i, best - 1], score[i, best], score[i, best + 1]
        bend = max(2 * here - before - after, 1e-9)
        off = min(max(0.5 * (after - before) / bend, -1.0), 1.0)
        place[i, 0] = STEP_PX * (best - _WAY + off)
        sharpness[i] = bend / STEP_PX**2
    return place, np.median(sharpness)


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    polygon.compile_ahead()
    table = np.zeros((2 * int(REACH_PX / STEP_PX) + 1, 1), np.float32)
    place, columns = np.zeros((1, 2)), np.zeros((1, 1), np.uint8)
    _highest(_scores(place, place + 1, columns, table))
    _lacking_light(place, place + 1, columns, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0)
