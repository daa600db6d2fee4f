"""What holes in a reading may hide: the mirror may go deeper where no node was measured.

The larger of two answers. The slopes at the rim, continued linearly: exact for a cone, twice too deep for a
paraboloid. But a narrow dent may lie wholly in the hole that it makes itself, or in one of dirt, its rim as
flat as at rest. It cannot be read because it bends the mirror as much as folds the image: it may be as deep
as a paraboloid of that curvature, as wide as the hole less a sensing window. A hole that went dark may hold a
contact smaller than itself, next to which depth goes on rising, as 1/r, to the contact's border.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from zeromethod.arrays import Float, Mask
from zeromethod.surface.surface import Surface

_WINDOW_NODES = 3.0
"""Distance of a single unreadable place from the next measured node: nodes fail as far from it as the sensing
window's half width, 2 nodes, and the next one is measured."""
_LEAST_CONTACT_NODES = 0.5
"""Radius of the smallest contact that darkens a node's window."""


def fold_per_mm(bending: Float, spacing_px: float, sensitivity: Float, point: Float, nodes: Mask) -> float:
    """Curvature of the mirror, 1/mm, at which its image folds: median over the nodes (rows, cols).

    bending: (rows, cols, 2, 2) LCD px per camera px at rest. sensitivity: (rows, cols, 2, 2) LCD px per rad.
    point: (rows, cols, 3) mirror points, mm. Alike in both directions, the geometric mean.
    """
    node_mm2 = _area(point)
    known = nodes & (node_mm2 > 0.0)
    if not known.any():
        return 0.0
    per_node = np.abs(np.linalg.det(bending[known])) * spacing_px**2
    per_rad = np.abs(np.linalg.det(sensitivity[known]))
    return float(np.median(np.sqrt(per_node / (per_rad * node_mm2[known]))))


def deeper_inside_mm(surface: Surface, measured: Mask, fitted: Mask, depth_mm: float) -> float:
    """How much deeper than depth_mm the mirror may be where it was not measured, mm; 0 for no deeper.

    measured, fitted: (rows, cols); nodes inside a fit's window count as known.
    """
    unknown = ~measured & ~fitted & surface.on_mirror
    if not unknown.any():
        return 0.0
    row, col = _nearest(surface.valid.tobytes(), surface.valid.shape)
    rim = row[unknown], col[unknown]
    away = np.stack([a[unknown] - a[rim] for a in (surface.x_mm, surface.y_mm)], axis=-1)
    sign = np.sign(depth_mm)
    steeper = sign * (surface.slope[rim] * away).sum(axis=-1)
    hidden = _Holes(surface, unknown, away)
    steeper = np.maximum(steeper, hidden.touched_mm(steeper))
    further = sign * surface.depth_mm[rim] + np.maximum(steeper, hidden.bent_mm())
    return max(float(np.nanmax(further)) - abs(depth_mm), 0.0)


def tip_in_holes_mm(surface: Surface, dark: Mask, depth_mm: float, largest_mm2: float) -> float:
    """Standard deviation of how much deeper a tip may go in the holes of dark nodes (rows, cols), mm.

    From afar, a cone of flank f that is pressed in by d makes the slope s = d a / (pi r^2), and touches up to
    a = 2 d / (pi tan f) (Sneddon 1965, doi:10.1016/0020-7225(65)90019-4): d = pi r sqrt(s tan f / 2). This is
    its rms over all tan f up to 1, where linear elasticity ends; 0 where only a tip that touches more than
    largest_mm2 makes slopes as steep. depth_mm: beside the holes; its sign counts.
    """
    unread = ~surface.valid & surface.on_mirror
    _, labels = cv2.connectedComponents(unread.view(np.uint8), connectivity=4)
    hole = np.isin(labels, labels[dark & unread]) & unread
    if not hole.any():
        return 0.0
    row, col = _nearest(surface.valid.tobytes(), surface.valid.shape)
    rim = row[hole], col[hole]
    away = np.stack([a[hole] - a[rim] for a in (surface.x_mm, surface.y_mm)], axis=-1)
    away_mm = np.hypot(*away.T)
    inwards = np.sign(depth_mm) * (surface.slope[rim] * away).sum(axis=-1) / np.maximum(away_mm, 1e-9)
    strength_mm2 = max(float(inwards.mean()), 0.0) * float(away_mm.max()) ** 2
    # s r^2 = a^2 tan f / 2
    return 0.0 if strength_mm2 > 0.5 * largest_mm2 / np.pi else 0.5 * np.pi * float(np.sqrt(strength_mm2))


class _Holes:
    """Unknown nodes (n,) in holes that measured ones enclose. away_mm: (n, 2) from the next measured node."""

    def __init__(self, surface: Surface, unknown: Mask, away_mm: Float) -> None:
        _, labels, stats, _ = cv2.connectedComponentsWithStats(
            (~surface.valid).view(np.uint8), connectivity=4
        )
        rows, cols = unknown.shape
        left, top, width, height = stats.T[:4]
        enclosed = (left > 0) & (top > 0) & (left + width < cols) & (top + height < rows)
        self._surface, self._count = surface, len(stats)
        self._hole, self._dark = labels[unknown], surface.contact[unknown]
        self._inside = enclosed[self._hole]
        self._away_mm = np.hypot(*away_mm.T)
        node_mm2 = _area(np.stack([surface.x_mm, surface.y_mm], axis=-1))[surface.valid]
        self._node_mm = float(np.sqrt(np.nanmedian(node_mm2)))

    def bent_mm(self) -> Float:
        """(n,) depth over the rim of a paraboloid as bent as folds; 0 beside such holes."""
        hidden_mm = np.maximum(self._away_mm - _WINDOW_NODES * self._node_mm, 0.0)
        return np.asarray(np.where(self._inside, 0.5 * self._surface.fold_per_mm * hidden_mm**2, 0.0))

    def touched_mm(self, steeper_mm: Float) -> Float:
        """(n,) depth over the rim at the border of a contact, in holes that went dark; 0 in others.

        By the mean slope all around: one flank of a dent that went dark is no contact. steeper_mm: (n,) the
        rim's slope continued.
        """
        dark = self._inside & (np.bincount(self._hole[self._dark], minlength=self._count) > 0)[self._hole]
        found = np.zeros(dark.size)
        hole, away_mm = self._hole[dark], self._away_mm[dark]
        radius_mm = np.zeros(self._count)
        np.maximum.at(radius_mm, hole, away_mm)
        inwards = np.bincount(hole, steeper_mm[dark] / np.maximum(away_mm, 1e-9), self._count)
        slope = inwards / np.maximum(np.bincount(hole, minlength=self._count), 1)
        contact_mm = np.maximum(
            radius_mm - _WINDOW_NODES * self._node_mm, _LEAST_CONTACT_NODES * self._node_mm
        )
        # of slope * radius^2 / r, from the rim to there
        risen_mm = slope * np.maximum(radius_mm - contact_mm, 0.0) * radius_mm / contact_mm
        found[dark] = np.maximum(risen_mm, 0.0)[hole]
        return found


@lru_cache(maxsize=2)
def _nearest(measured: bytes, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Row and column (2, rows, cols) of the nearest measured node; of a mask that mostly stays."""
    mask = np.frombuffer(measured, bool).reshape(shape)
    found: NDArray[np.int32] = ndimage.distance_transform_edt(
        ~mask, return_distances=False, return_indices=True
    )
    return found


def _area(point: Float) -> Float:
    """Area (rows, cols) of the mirror per node, mm^2. point: (rows, cols, 2 or more) mm."""
    down, along = (np.gradient(point[..., :2], axis=axis) for axis in (0, 1))
    return np.asarray(np.abs(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]))
