"""What one frame brings to the fine reading: its image, the target's phases in it, and the warps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.warp import Warp


@dataclass(frozen=True, slots=True)
class Steps:
    """Phases of the target's two carriers in one frame, for every image row, last axis along u, v.

    phase_rad: (rows, 2) the target's shift; its carriers are cos(k u + phase) and cos(k v + phase).
    contrast: (rows, 2) share of the carriers' amplitude that two pictures in one exposure leave.
    per_late_rad: (rows, 2) what the phase changes by, rad/s, when the pictures came later than logged.
    """

    phase_rad: Float
    contrast: Float
    per_late_rad: Float

    @classmethod
    def constant(cls, rows: int, u_rad: float, v_rad: float) -> Steps:
        """The same phases in all rows, at full contrast, whenever they came."""
        phase = np.broadcast_to(np.array([u_rad, v_rad]), (rows, 2))
        return cls(phase, np.ones((rows, 2)), np.zeros((rows, 2)))


@dataclass(frozen=True, slots=True)
class FineFrame:
    """One frame for the fine reading.

    image: (rows, cols) grey levels. node_rad, node_contrast, node_late_rad_per_s: (node rows, node cols, 2)
    as `Steps`, where each node looks. shown: (node rows, node cols, 2) LCD px, the warp lit in it. measured:
    by this frame alone, with flags; its q is the shown one at (u, v) + d, and d (node rows, node cols, 2) is
    the residual, camera px.
    """

    image: Image
    node_rad: Float
    node_contrast: Float
    node_late_rad_per_s: Float
    shown: Float
    measured: Warp
    d: Float

    def steps(self, grid: NodeGrid) -> Steps:
        """Phases by image row: the means over each row's nodes, linear between rows of nodes."""
        v, inner = np.arange(grid.image_shape[0], dtype=np.float64), grid.inner[1]
        fields = self.node_rad, self.node_contrast, self.node_late_rad_per_s
        means = (one[:, inner].mean(axis=1) for one in fields)
        return Steps(*(np.stack([np.interp(v, grid.v_px, m[:, k]) for k in (0, 1)], axis=-1) for m in means))

    def off_row_rad(self) -> Float:
        """(node rows, node cols, 2) by which a node's phase differs from its row's in `steps`."""
        return np.asarray(self.node_rad - self.node_rad[:, PADDING:-PADDING].mean(axis=1, keepdims=True))
