"""Rays of every node by the mirror at rest, on which all design figures are based."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.errors import InputError
from zeromethod.optics import Optics, Trace
from zeromethod.rig.model import Rig
from zeromethod.warp.grid import NodeGrid

_STEP_PX = 0.25
"""Camera px to either side for derivatives along the image."""
_REGIONS = 3


@dataclass(frozen=True)
class Region:
    """One of nine parts of the image. mask: (rows, cols) its nodes that see the LCD; x_mm, y_mm: medians."""

    x_mm: float
    y_mm: float
    mask: Mask


class SampledView:
    """The measurable nodes of a rig's camera, their rays by the mirror at rest, and their derivatives.

    Convention: matrices (rows, cols, 2, 2) are indexed [..., what changes, by what]; q = (column, row) in LCD
    px, u = (column, row) in camera px, p = (x, y) in mm. NaN where a ray is lost before the LCD's plane.
    """

    def __init__(self, rig: Rig) -> None:
        """Trace every node. Raises InputError (one line) where no node sees the LCD by the mirror."""
        self.rig = rig
        self.optics = Optics(rig)
        self.grid = NodeGrid.of_rig(rig)
        u, v = self.grid.mesh()
        self.u_px: Float = u[self.grid.inner]
        self.v_px: Float = v[self.grid.inner]
        self.trace: Trace = self.optics.trace(self.u_px, self.v_px, self.optics.rest)
        self.on_lcd: Mask = self.trace.reaches_display
        if np.count_nonzero(self.on_lcd) < 4:
            raise InputError(f"rig {rig.name}: no camera pixel sees the LCD by the mirror at rest")

    @property
    def x_mm(self) -> Float:
        """(rows, cols) mirror points along the mirror; NaN where a ray meets none."""
        return self.trace.point[..., 0]

    @property
    def y_mm(self) -> Float:
        """(rows, cols) mirror points across."""
        return self.trace.point[..., 1]

    @cached_property
    def direction(self) -> Float:
        """(rows, cols, 3) unit rays in the rubber towards the mirror."""
        return self.optics.rubber_rays(self.u_px, self.v_px)[1]

    @cached_property
    def sensitivity(self) -> Float:
        """dq/dslope: LCD px per rad of the depth's slope (dd/dx, dd/dy)."""
        return self.optics.sensitivity(self.u_px, self.v_px)

    @cached_property
    def _by_camera(self) -> tuple[Float, Float]:
        """dq/du, LCD px per camera px, and dp/du, mm of mirror per camera px."""
        q, p = [], []
        for du, dv in ((_STEP_PX, 0.0), (0.0, _STEP_PX)):
            ahead = self.optics.trace(self.u_px + du, self.v_px + dv, self.optics.rest)
            back = self.optics.trace(self.u_px - du, self.v_px - dv, self.optics.rest)
            q.append((ahead.q - back.q) / (2 * _STEP_PX))
            p.append((ahead.point - back.point)[..., :2] / (2 * _STEP_PX))
        return np.stack(q, axis=-1), np.stack(p, axis=-1)

    @property
    def lcd_per_camera(self) -> Float:
        """dq/du at rest: LCD px per camera px."""
        return self._by_camera[0]

    @property
    def mirror_per_camera(self) -> Float:
        """dp/du at rest: mm of mirror per camera px."""
        return self._by_camera[1]

    @cached_property
    def regions(self) -> list[Region]:
        """The image's thirds by thirds, by rising x and y; parts that see no LCD are left out."""
        found = []
        thirds = [
            [slice(k * n // _REGIONS, (k + 1) * n // _REGIONS) for k in range(_REGIONS)]
            for n in self.on_lcd.shape
        ]
        for rows, columns in product(*thirds):
            mask = np.zeros_like(self.on_lcd)
            mask[rows, columns] = self.on_lcd[rows, columns]
            if mask.any():
                x_mm, y_mm = float(np.median(self.x_mm[mask])), float(np.median(self.y_mm[mask]))
                found.append(Region(x_mm, y_mm, mask))
        return sorted(found, key=lambda region: (round(region.x_mm), round(region.y_mm)))

    @property
    def central(self) -> Region:
        """The region nearest to the middle of the view."""
        x, y = (float(np.nanmedian(values[self.on_lcd])) for values in (self.x_mm, self.y_mm))
        return min(self.regions, key=lambda region: np.hypot(region.x_mm - x, region.y_mm - y))


def median_over(values: Float, mask: Mask) -> list[float]:
    """Median over the masked nodes of each of the last axis' components; NaN nodes do not count.

    values: (rows, cols, n). NaN where no node counts.
    """
    chosen = values[mask]
    known = np.isfinite(chosen).all(axis=-1)
    if not known.any():
        return [float("nan")] * values.shape[-1]
    return [float(middle) for middle in np.median(chosen[known], axis=0)]


def inverse(matrices: Float) -> Float:
    """Inverses of (..., 2, 2) matrices; NaN where one is singular or not finite."""
    a, b, c, d = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 0], matrices[..., 1, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        determinant = a * d - b * c
        adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        result: Float = adjugate / determinant[..., None, None]
    return np.where(np.isfinite(result), result, np.nan)
