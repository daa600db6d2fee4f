"""The warp of the untouched mirror: where every reading starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag


@dataclass(frozen=True)
class Rest:
    """The warp at rest on a grid.

    q: (rows, cols, 2) LCD px, finite everywhere: continued where no ray arrives. flags: (rows, cols)
    uint16, NO_RAY there, else 0. seen: (rows, cols) measurable nodes whose ray ends at least one carrier
    period inside the panel. display_size: (columns, rows) LCD px.
    """

    grid: NodeGrid
    q: NDArray[np.float64]
    flags: NDArray[np.uint16]
    seen: NDArray[np.bool_]
    display_size: tuple[int, int]

    def without(self, covered: NDArray[np.bool_]) -> Rest:
        """Take out nodes (rows, cols) that cannot be measured; their warp is drawn all the same."""
        return replace(self, seen=self.seen & ~covered)

    @classmethod
    def of(cls, rig: Rig, optics: Optics) -> Rest:
        """Rest warp by the rig's geometry; InputError when no node sees the panel."""
        camera, target = rig.camera, rig.target
        grid = NodeGrid((camera.rows, camera.columns), target.period_px)
        trace = optics.trace(*grid.mesh(), optics.rest)
        return cls.from_map(grid, trace.q, (rig.display.columns, rig.display.rows))

    @classmethod
    def from_map(cls, grid: NodeGrid, q: NDArray[np.float64], display_size: tuple[int, int]) -> Rest:
        """Rest warp from LCD positions (rows, cols, 2), NaN where no ray arrives."""
        known: NDArray[np.bool_] = np.asarray(np.isfinite(q).all(axis=-1))
        if np.count_nonzero(known[grid.inner]) < 16:
            raise InputError("rig: fewer than 16 camera nodes see the display's plane by the mirror at rest")
        u, v = grid.mesh()
        plane = np.stack([np.ones_like(u), u, v], axis=-1)
        terms = np.linalg.lstsq(plane[known], q[known], rcond=None)[0]
        affine = plane @ terms
        whole = affine + continue_smoothly(np.where(known[..., None], q - affine, 0.0), known)
        whole[known] = q[known]
        flags = np.where(known, np.uint16(0), np.uint16(Flag.NO_RAY))
        inside = warp_flags(whole, whole, grid.period_px, display_size, spacing_px=grid.spacing_px) == 0
        measurable = np.zeros_like(known)
        measurable[grid.inner] = True
        return cls(grid, whole, flags, known & inside & measurable, display_size)
