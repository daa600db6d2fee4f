"""Which points of a matched field may be trusted, and why not the others."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Float, Mask
from zeromethod.passive.displacement import Doubt

WEAK_PX = 0.25
"""Largest standard deviation of a point that still counts as measured."""

UNSETTLED_PX = 0.2
"""Last change of the field up to which grey levels are straight enough between the two (or `_SIGMAS`)."""

_SIGMAS = 3.0

LEAST_STRETCH, MOST_STRETCH = 0.3, 3.0
"""Local magnifications beyond these are a fold, or a jump to another period, rather than a picture."""


def stretch(field: Float, spacing_px: float) -> tuple[Float, Float]:
    """Least and largest magnification (rows, cols) from reference to image, by the field's differences.

    They are the singular values of I + grad d; the least is negative where the picture is turned over.
    """
    by_row = np.asarray(np.gradient(field, spacing_px, axis=0))
    by_col = np.asarray(np.gradient(field, spacing_px, axis=1))
    a, b, c, d = 1.0 + by_col[..., 0], by_row[..., 0], by_col[..., 1], 1.0 + by_row[..., 1]
    both = 0.5 * np.hypot(a + d, b - c)
    apart = 0.5 * np.hypot(a - d, b + c)
    return both - apart, both + apart


def _next_to_jump(field: Float, spacing_px: float) -> Mask:
    """Points (rows, cols) that differ from a neighbour by more than the distance to it."""
    out = np.zeros(field.shape[:2], dtype=bool)
    down = np.abs(np.diff(field, axis=0)).max(axis=-1) > spacing_px
    across = np.abs(np.diff(field, axis=1)).max(axis=-1) > spacing_px
    out[:-1] |= down
    out[1:] |= down
    out[:, :-1] |= across
    out[:, 1:] |= across
    return out


def largest_part(mask: Mask) -> Mask:
    """The largest part of a mask (rows, cols) whose cells touch by their sides."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    if count < 2:
        return mask
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def unsettled(sigma: Float, step: Float) -> Mask:
    """Points (rows, cols) whose last change, step (rows, cols) px, was too large for their sigma (..., 2)."""
    return np.asarray(~(step <= np.maximum(UNSETTLED_PX, _SIGMAS * _worst(sigma))))


def _worst(sigma: Float) -> Float:
    return np.asarray(np.where(np.isfinite(sigma).all(axis=-1), sigma.max(axis=-1), np.inf))


def doubts(field: Float, sigma: Float, step: Float, seen: Mask, alike: Mask, spacing_px: float) -> Bytes:
    """`Doubt` bits (rows, cols) of a field (rows, cols, 2) px with points spacing_px apart.

    sigma (rows, cols, 2) px. step (rows, cols) px: the last change of the field. seen: cells that both
    images show. alike: cells whose grey levels match.
    """
    out = np.zeros(seen.shape, dtype=np.uint8)
    out[~seen] |= np.uint8(Doubt.OUTSIDE)
    out[seen & ~alike] |= np.uint8(Doubt.MISMATCH)
    out[seen & ~(_worst(sigma) <= WEAK_PX)] |= np.uint8(Doubt.TEXTURE)
    out[seen & unsettled(sigma, step)] |= np.uint8(Doubt.UNSETTLED)
    least, most = stretch(field, spacing_px)
    torn = (least < LEAST_STRETCH) | (most > MOST_STRETCH) | _next_to_jump(field, spacing_px)
    out[torn] |= np.uint8(Doubt.ORDER)
    sound = out == 0
    out[sound & ~largest_part(sound)] |= np.uint8(Doubt.ORDER)
    return out
