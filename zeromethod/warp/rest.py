"""The warp of the untouched mirror: where every reading starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.warp.continuation import continue_smoothly, continued
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import areas, warp_flags
from zeromethod.warp.rest_pixels import RestGrid
from zeromethod.warp.seams import SeamMap
from zeromethod.warp.validity import Flag

LEAST_NODES = 16
"""Nodes that must see the display for there to be anything to null."""

_FOUND_LCD_PX = 0.01
"""Rays that were found miss by 1e-6 LCD px; one that was not, by what the map differs from the geometry."""


def _measured(grid: NodeGrid, model_q: Float, file: Path, optics: Optics) -> tuple[RestGrid, Float]:
    """Nodes on the rays that a measured rest names, and its LCD positions, NaN where it has none.

    Beyond what was measured the difference from the geometry is continued: in the padding, which is drawn,
    and for the rays of nodes that the map leaves out.
    """
    from zeromethod.warp.rest_map import RestMap  # noqa: PLC0415 - loads slowly; few rigs have one

    rest_map = RestMap.load(file)
    if rest_map.valid.shape != grid.image_shape:
        rows, cols = rest_map.valid.shape
        raise InputError(
            f"camera.rest_map: {file}: {cols} x {rows} px: the camera has "
            f"{grid.image_shape[1]} x {grid.image_shape[0]}"
        )
    warp = rest_map.warp(grid)
    away = warp.q - model_q
    measured = warp.valid & np.isfinite(away).all(axis=-1)
    if np.count_nonzero(measured) < LEAST_NODES:
        raise InputError(f"{file}: fewer than {LEAST_NODES} nodes see the display")
    away[~measured] = 0.0
    q = model_q + continue_smoothly(away, measured)
    rays = RestGrid.of(grid, optics, q)
    # at the mirror's border there may be none: what a node reads by another's ray is no depth
    left_out = ~(measured & (np.abs(optics.rest_map(*rays.mesh()) - q) < _FOUND_LCD_PX).all(axis=-1))
    left_out[warp.flags & np.uint16(Flag.OUTSIDE) != 0] = False
    return rays, np.where(left_out[..., None], np.nan, q)


@dataclass(frozen=True)
class Rest:
    """The warp at rest on a grid.

    q: (rows, cols, 2) LCD px, finite everywhere: continued where no ray arrives. flags: (rows, cols)
    uint16, NO_RAY there, SEAM at a saw's seams, else 0. visible: (rows, cols) nodes measurable and visible at
    rest: their ray ends at least one carrier period inside the panel. display_size: (columns, rows) LCD px.
    seams: a saw's; None of a prism.
    """

    grid: NodeGrid
    q: Float
    flags: Flags
    visible: Mask
    display_size: tuple[int, int]
    seams: SeamMap | None = None

    @cached_property
    def areas(self) -> Float:
        """(rows, cols) area on the LCD per node, LCD px^2."""
        return areas(self.q)

    def without(self, covered: Mask) -> Rest:
        """Take out nodes (rows, cols) that cannot be measured; their warp is drawn all the same."""
        return replace(self, visible=self.visible & ~covered)

    def _with_seams(self, seams: SeamMap) -> Rest:
        """With nodes that see a seam flagged; their warp is drawn all the same."""
        seam = self.grid.padded(seams.touched(np.zeros(seams.x_mm.shape)), False)
        flags = np.where(seam, self.flags | np.uint16(Flag.SEAM), self.flags)
        return replace(self, flags=flags, visible=self.visible & ~seam, seams=seams)

    @classmethod
    def of(cls, rig: Rig, optics: Optics) -> Rest:
        """Rest warp as measured where the rig names a rest map, else by its geometry.

        With a rest map the grid is a `RestGrid`, and nodes without a valid part of the map are not visible.
        Raises InputError when no node sees the panel, or the map is not one of this camera.
        """
        grid = NodeGrid.of_rig(rig)
        q = optics.trace(*grid.mesh(), optics.rest).q
        if rig.camera.rest_map is not None:
            grid, q = _measured(grid, q, rig.camera.rest_map, optics)
        rest = cls.from_map(grid, q, (rig.display.columns, rig.display.rows))
        seams = SeamMap.of(optics, grid)
        return rest if seams is None else rest._with_seams(seams)

    @classmethod
    def from_map(cls, grid: NodeGrid, q: Float, display_size: tuple[int, int]) -> Rest:
        """Rest warp from LCD positions (rows, cols, 2), NaN where no ray arrives."""
        known: Mask = np.asarray(np.isfinite(q).all(axis=-1))
        if np.count_nonzero(known[grid.inner]) < LEAST_NODES:
            raise InputError(
                f"rig: fewer than {LEAST_NODES} camera nodes see the display's plane by the mirror at rest"
            )
        whole = continued(q, *grid.mesh())
        flags = np.where(known, np.uint16(0), np.uint16(Flag.NO_RAY))
        inside = warp_flags(whole, whole, grid.period_px, display_size, spacing_px=grid.spacing_px) == 0
        visible: Mask = known & inside & grid.measurable
        if not visible.any():
            raise InputError(
                "rig: no node of the camera's view sees LCD pixels that are fine enough for the target "
                "(4 in each period): display.pitch_mm, camera.focal_px, where camera and LCD stand"
            )
        return cls(grid, whole, flags, visible, display_size)
