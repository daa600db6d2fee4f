"""Contacts of many narrow parts: ridges, bars, grains with reflecting rubber between them.

Less than a period wide, no part is a flat place and no gap shows a carrier. What distinguishes them from a
picture is that one dark grey level is far too common: a picture has every level about as often as any other.
And what lies nearer than a period to each other is one contact, as nothing between could be measured.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from zeromethod.arrays import Mask, Single
from zeromethod.contact.median import median
from zeromethod.contact.pieces import pieces

_LEAST_SHARE = 0.2
"""Share of the pixels over a period's square that have the level, within noise; in a picture some 0.1 do."""
_MOST_DARKER = 0.15
"""Pixels there that may be darker, over those that have the level: shadows of a white object's edges."""
MOST_FILLED = 0.85
"""Share of a patch that parts fill, above which it has no gaps."""
_NOISES = 2.5
"""Standard deviations of noise within which light is of one level."""
BRIGHTEST = 0.4
"""Of the picture's mean: a perfectly white object scatters cos(pattern angle) / index^2 = 0.32 of it."""


class Parts(NamedTuple):
    """Where narrow parts touch: where the level is common (rows, cols), and that level, over the mean."""

    where: Mask
    light: float


def narrow_parts(
    light: Single, noise: float, lost: Mask, period_px: int, known: Mask | None = None
) -> Parts | None:
    """Patches of at least a period's square in which one dark level is too common; None for none.

    light: (rows, cols) over that of the picture's mean. noise: its standard deviation. lost: (rows, cols)
    pixels without a carrier that are not dirt. known: (rows, cols) what flat places explain already; where
    they and half a period around leave too few dark pixels, none is looked for.
    """
    dark = lost & (light < BRIGHTEST)
    other = np.ones(dark.shape, np.bool_)
    if known is not None and known.any():
        square = np.ones((period_px, period_px), np.uint8)
        other = cv2.dilate(known.astype(np.uint8), square) == 0
    if np.count_nonzero(dark & other) < _LEAST_SHARE * period_px**2:
        return None
    values = light[dark]
    counts = np.bincount(np.maximum((values + 0.05) / noise, 0).astype(np.intp))
    near = np.convolve(counts, np.ones(round(2 * _NOISES)), "same")
    middle = (int(np.argmax(near)) + 0.5) * noise - 0.05
    near_level = values[np.abs(values - middle) < _NOISES * noise]
    level = median(near_level)
    alike = dark & (np.abs(light - level) < _NOISES * noise)
    side = period_px, period_px
    share = cv2.boxFilter(alike.astype(np.float32), -1, side)
    darker = cv2.boxFilter((light < level - _NOISES * noise).astype(np.float32), -1, side)
    labels, sizes = pieces((share > _LEAST_SHARE) & (darker < _MOST_DARKER * share) & lost)
    where = (sizes >= period_px**2)[labels]
    return Parts(where, level) if np.count_nonzero(where & other) >= period_px**2 else None


def closed_over(mask: Mask, period_px: int) -> Mask:
    """The mask with all gaps of less than a period closed."""
    round_one = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (period_px + 1, period_px + 1))
    closed = mask.copy()
    # nothing is added beyond a box round it
    box = cv2.boundingRect(mask.view(np.uint8))
    part = slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2])
    wide = cv2.copyMakeBorder(mask[part].view(np.uint8), *4 * (period_px,), cv2.BORDER_CONSTANT)
    inner = slice(period_px, -period_px)
    if box[2]:
        closed[part] = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, round_one)[inner, inner] > 0
    return closed
