"""Textures that rub along the mirror: cloth, pile, brushes and sandpaper as fields of stiff, rounded tips."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from zeromethod.arrays import Float

_NEAREST = 8
"""Tips that a place is compared with; the one that stands out furthest there counts."""


class Weave(enum.StrEnum):
    """How tips are laid: in a square array, at random, crossing like yarns, or as grains of any size."""

    BRUSH = "brush"
    PILE = "pile"
    WOVEN = "woven"
    SANDPAPER = "sandpaper"


_JITTER = {Weave.BRUSH: 0.03, Weave.PILE: 0.45, Weave.WOVEN: 0.03, Weave.SANDPAPER: 0.5}
"""Largest distance of a tip from its place in the array along either axis, over the pitch."""
_STRETCH = {Weave.WOVEN: 2.0}
"""Length of a tip's round over its width; that of crossing yarns lies alternately along and across."""


@dataclass(frozen=True, slots=True)
class Texture:
    """A texture: pitch_mm from tip to tip (random ones: on average), each of radius tip_mm.

    height_mm: standard deviation of the tips' heights. seed: of places, heights and grain sizes.
    """

    weave: Weave
    pitch_mm: float
    tip_mm: float
    height_mm: float
    seed: int = 0

    def profile(self, along: Float, across: Float, radius_mm: float) -> Float:
        """Height, mm, over the highest tip within `radius_mm`; beside any tip that of its nearest."""
        tips = _tips(self, radius_mm)
        at = np.stack((along, across), axis=-1)
        _, near = cKDTree(tips[:, :2]).query(at, k=_NEAREST)
        off = at[..., None, :] - tips[near, :2]
        low, bow_along, bow_across = (tips[near, k] for k in (2, 3, 4))
        height = low + 0.5 * (bow_along * off[..., 0] ** 2 + bow_across * off[..., 1] ** 2)
        return np.asarray(height.min(axis=-1))


@lru_cache(16)
def _tips(texture: Texture, radius_mm: float) -> Float:
    """(n, 5): along, across, mm below the highest, curvatures along and across, 1/mm."""
    draw = np.random.default_rng(texture.seed)
    pitch, weave = texture.pitch_mm, texture.weave
    half = int(np.ceil(radius_mm / pitch)) + 2
    row, col = (axis.ravel() for axis in np.mgrid[-half : half + 1, -half : half + 1])
    jitter = _JITTER[weave] * draw.uniform(-1, 1, (2, row.size))
    along, across = pitch * (col + jitter[0]), pitch * (row + jitter[1])
    height = texture.height_mm * draw.standard_normal(row.size)
    size = texture.tip_mm * (draw.uniform(0.5, 1.5, row.size) if weave is Weave.SANDPAPER else 1.0)
    stretch = _STRETCH.get(weave, 1.0)
    lies = (row + col) % 2 == 0
    by_along = 1 / (size * np.where(lies, stretch**2, 1.0))
    by_across = 1 / (size * np.where(lies, 1.0, stretch**2))
    inside = np.hypot(along, across) < radius_mm
    low = height[inside].max(initial=0.0) - height
    return np.stack((along, across, low, by_along, by_across), axis=-1)
