"""Coarse to fine: a start within reach of the fine match, whatever the displacement.

A pyramid of halved images finds what is large; on every level the part that matches grows outwards, each
front following the slope of what already fits, which carries periodic textures over many periods.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.passive.matching import PADDING, Matcher, padded
from zeromethod.passive.moving_fit import moving_fit
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.interpolant import sample

SMALLEST_PX = 40
"""Shorter side of the pyramid's coarsest image, at least."""
CELL_PX, WINDOW_PX = 4, 8.0
"""Side of the cells of the field, and standard deviation of the window that it is fitted under."""
_STEP_PX = 1.5
"""Longest step in one round: grey differences are linear in the displacement no farther."""
_ROUNDS, _SETTLED_PX = 12, 0.02
"""Rounds per level at most; they end when 99 % of the cells move by less than this."""
_LEAST_SHARE = 0.02
"""Share of the cells that must match for the others to follow them, and not all that has texture."""
_CLEARLY = 1.2
"""A shift must match this much more than rest: of a regular texture's many matches, rest is the likeliest."""


def pyramid(grey: Single) -> list[Single]:
    """Image (rows, cols) and its halvings, finest first."""
    levels = [grey]
    while min(levels[-1].shape) >= 2 * SMALLEST_PX:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.float32))
    return levels


def settle(matcher: Matcher, field: Float, rounds: int, window_px: float = WINDOW_PX) -> Float:
    """Improve a field (cell rows, cell cols, 2) px until it stays; others follow the cells that match."""
    sigma = (window_px / matcher.size, window_px / matcher.size)
    for _ in range(rounds):
        comparison = matcher.compare(field)
        weight = np.where(comparison.shown, np.clip(comparison.match, 0.05, 1.0) ** 2, 0.0)
        none = np.zeros_like(weight)
        # Nothing is taken for noise yet: far from the match, all of the texture would be.
        fitted, _ = moving_fit(comparison.sums * weight[..., None], none, none, field, sigma, 1)
        step = fitted - field
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, _STEP_PX / np.maximum(length, 1e-9))
        known = np.asarray(np.isfinite(step).all(axis=-1))
        good = comparison.alike & known
        field = np.where(known[..., None], field + np.where(known[..., None], step, 0.0), field)
        if good.mean() > _LEAST_SHARE:
            field = continue_smoothly(field, good)
            moved = length[..., 0][good]
        else:
            field = continue_smoothly(field, known)
            moved = length[..., 0][known]
        if moved.size and np.percentile(moved, 99) < _SETTLED_PX:
            break
    return field


def resampled(field: Float, size: int, shape: tuple[int, int], new_size: int, scale: float) -> Float:
    """Field of cells of `size` px read at cells (shape) of `new_size` px in an image `scale` times larger."""
    at = [
        np.clip((np.arange(n) + 0.5) * new_size / (scale * size) - 0.5, -1.0, old) + PADDING
        for n, old in zip(shape, field.shape, strict=False)
    ]
    col, row = np.meshgrid(at[1], at[0])
    return scale * sample(padded(field), col, row)


def search(references: list[Single], images: list[Single]) -> Float:
    """Field (cell rows, cell cols, 2) px of the finest level, on cells of `CELL_PX`, from no guess at all."""
    field: Float | None = None
    for reference, image in zip(references[::-1], images[::-1], strict=True):
        matcher = Matcher(reference, image, CELL_PX)
        if field is None:
            field = _coarsest(matcher, reference, image)
        else:
            field = resampled(field, CELL_PX, matcher.shape, CELL_PX, 2.0)
            field = settle(matcher, field, _ROUNDS)
    assert field is not None
    return field


def _coarsest(matcher: Matcher, reference: Single, image: Single) -> Float:
    """Field of the coarsest level: from rest, or from one shift of all where that clearly matches more."""
    rest = np.zeros((*matcher.shape, 2))
    hanning = cv2.createHanningWindow(reference.shape[::-1], cv2.CV_32F)
    # Copies: OpenCV multiplies its arguments by the window in place where their size suits its transform.
    shift, _ = cv2.phaseCorrelate(reference.copy(), image.copy(), hanning)
    fields = [settle(matcher, start, _ROUNDS) for start in (rest, rest + shift)]
    shares = [float(matcher.compare(field).alike.mean()) for field in fields]
    return fields[1] if shares[1] > _CLEARLY * shares[0] else fields[0]
