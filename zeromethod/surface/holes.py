"""What holes in a reading leave open about its deepest point."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from zeromethod.arrays import Mask
from zeromethod.surface.gaps import gaps_between
from zeromethod.surface.surface import Surface

_SECTORS = 24
_NOTICEABLE = 0.02
"""Step over a gap, relative to the peak, from which it counts as lying on the slope."""


def deeper_inside_mm(surface: Surface, measured: Mask, fitted: Mask, depth_mm: float) -> float:
    """How much deeper than depth_mm the mirror may be where it was not measured, mm; 0 for no deeper.

    Depth goes on from the nearest measured node with the slope it has there. measured, fitted: (rows, cols);
    nodes that a fit reached over count as known. A paraboloid's middle lies half as far down as this says, a
    cone's tip as far.
    """
    unknown = ~measured & ~fitted & np.isfinite(surface.x_mm) & np.isfinite(surface.y_mm)
    if not unknown.any():
        return 0.0
    _, (row, col) = ndimage.distance_transform_edt(~surface.valid, return_indices=True)
    rim = row[unknown], col[unknown]
    away = np.stack([a[unknown] - a[rim] for a in (surface.x_mm, surface.y_mm)], axis=-1)
    further = surface.depth_mm[rim] + (surface.slope[rim] * away).sum(axis=-1)
    return max(float(np.nanmax(np.sign(depth_mm) * further)) - abs(depth_mm), 0.0)


def around_mm(surface: Surface, fitted: Mask, x_mm: float, y_mm: float, depth_mm: float) -> float:
    """Standard deviation that gaps across the slope around a summit add to its depth, mm.

    Where a fold runs all around but for an opening, depth is told through that opening alone, past nodes as
    bent as those that were lost: every direction that is shut counts with the sigma of its gap. fitted:
    (rows, cols) nodes among which gaps do no harm.
    """
    seen = np.isfinite(surface.x_mm) & np.isfinite(surface.y_mm)
    if not (seen & ~surface.valid).any():
        return 0.0
    gaps = gaps_between(surface.valid, surface.valid)
    if not len(gaps):
        return 0.0
    point = np.stack([surface.x_mm, surface.y_mm], axis=-1)
    step, spread = gaps.steps(surface.slope, point)
    on_slope = (np.abs(step) > _NOTICEABLE * abs(depth_mm)) & ~(fitted[gaps.near] & fitted[gaps.far])
    middle = 0.5 * (point[gaps.near] + point[gaps.far]) - (x_mm, y_mm)
    turn = np.arctan2(middle[:, 1], middle[:, 0]) / (2 * np.pi) + 0.5
    sector = np.minimum((_SECTORS * turn).astype(np.intp), _SECTORS - 1)[on_slope]
    count = np.bincount(sector, minlength=_SECTORS)
    total = np.bincount(sector, spread[on_slope] ** 2, minlength=_SECTORS)
    return float(np.mean(np.sqrt(total / np.maximum(count, 1))))
