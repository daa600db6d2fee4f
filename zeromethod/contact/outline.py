"""A contact's border to a fraction of a pixel: where the light across it is likeliest (`contact.border`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.contact.border import IN_PX, STEP_PX, WAY, border_models, likeliest_model, scores
from zeromethod.contact.flank import across, lit
from zeromethod.contact.likelihood import GreyModel
from zeromethod.contact.median import median
from zeromethod.contact.polygon import evenly, normals, perimeter, signed_area, smooth

_PASSES, _CHOOSING = 4, 2
"""How often a border is moved; in the first ones it is asked, too, which picture lies beside it."""
_ASKED = 30
"""About so many points are asked."""
_APART_PX = 2.0
_ALONG_PX = 2.0
"""Standard deviation, along the border, of the window in which it moves as one."""
_SMOOTH_PX = 2.0
"""The same of what it is moved by."""
WINDOW_PX = 10.0
"""Length of border that moves as one: 2 sqrt(pi) times both together."""
_START_PX = 4.0
"""Standard deviation by which the border is smoothed first: dark stripes that join on stick out of it."""
_ALIKE = 8.0
"""Points next to each other that say one thing, as their picture is the same."""


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
    models = border_models(model.scattered_share, model.blur_px, model.relative_noise)
    once = smooth(points, _START_PX / _APART_PX)
    # twice, so that what bends stays
    points = resampled(2 * once - smooth(once, _START_PX / _APART_PX))
    picture = lit(columns, model.light)
    chosen, sharpness = 0, 0.0
    for number in range(_PASSES):
        out = normals(points)
        levels, known = across(points, out, picture, IN_PX)
        if number < _CHOOSING:
            every = max(len(points) // _ASKED, 1)
            chosen = likeliest_model(levels[::every], known[::every], models)
        score = scores(levels, known, models.one(chosen))
        moved, sharpness = _moved(smooth(score, _ALONG_PX / _APART_PX))
        points = resampled(points + smooth(moved, _SMOOTH_PX / _APART_PX) * out)
        if number < _PASSES - 1:
            points = smooth(points, 1.0 / _APART_PX)
    alone = 2 * math.sqrt(math.pi) * _ALONG_PX / _APART_PX / _ALIKE
    sigma = float(1 / np.sqrt(alone * max(sharpness, 1e-6)))
    return Outline(_bent(points, model.blur_px), min(sigma, 1.0))


def _moved(score: Float) -> tuple[Float, float]:
    """As `_highest`; where dirt hides the border, between what is seen on either side."""
    moved, sharpness = _highest(score)
    seen = np.flatnonzero(score.any(axis=1))
    if 0 < len(seen) < len(score):
        moved = np.interp(np.arange(len(score)), seen, moved[seen, 0], period=len(score))[:, None]
    return moved if len(seen) else np.zeros_like(moved), sharpness


def _bent(points: Float, blur_px: float) -> Float:
    """The border, with what blur and a polygon's chords take of one that bends outwards."""
    around = perimeter(points)
    # more than half of the light at a bent border comes from outside
    bend = math.pi * blur_px**2 / around
    chord = math.pi * (around / len(points)) ** 2 / (6 * around)
    return np.asarray(points + (bend + chord) * normals(points))


def _highest(score: Float) -> tuple[Float, float]:
    """(px (n, 1) of each row's highest point, median second derivative there, sign turned, 1/px^2)."""
    best = np.clip(score.argmax(axis=1), 1, score.shape[1] - 2)
    before, here, after = (score[np.arange(len(score)), best + step] for step in (-1, 0, 1))
    bend = np.maximum(2 * here - before - after, 1e-9)
    off = np.clip(0.5 * (after - before) / bend, -1.0, 1.0)
    return STEP_PX * (best - WAY + off)[:, None], median(bend) / STEP_PX**2
