"""What one frame brings to the fine reading: its image, the target's phases in it, and the warps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.warp import Warp

FRAMES = 24
"""Frames read together, 0.4 s at 60 per second. Of 16, noise may be 6 times as large: around a turn."""


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


@dataclass(frozen=True, slots=True)
class FrameSequence:
    """Frames seen against the mean of the warps that were lit in them.

    A frame's own warp differs from the mean by what the loop has followed, noise and lateness among it. The
    mean over each row of that is a phase like the target's own, and is added to it: else it would pass for
    lateness.

    steps: of every frame. shown: (rows, cols, 2) mean of the shown warps, LCD px. bending: (rows, cols, 2, 2)
    its Jacobian. apart: (N, rows, cols, 2) camera px, what a node's displacement differs by beyond its row's.
    scan: (image rows,) LCD rows at which image rows look, from -0.5 to 0.5.
    """

    steps: list[Steps]
    shown: Float
    bending: Float
    apart: Float
    scan: Float

    @classmethod
    def of(cls, frames: Iterable[FineFrame], grid: NodeGrid) -> FrameSequence:
        """Of frames with nodes on a grid."""
        frames = list(frames)
        v, inner = np.arange(grid.image_shape[0], dtype=np.float64), slice(PADDING, -PADDING)
        each = np.stack([frame.shown for frame in frames])
        shown = each.mean(axis=0)
        bending = jacobian(shown, grid.spacing_px)
        rad_per_px = 2 * np.pi / grid.period_px
        moved = matvec(np.asarray(np.linalg.inv(bending), np.float64), shown - each)
        rad = np.stack([frame.node_rad for frame in frames]) + rad_per_px * moved
        of_row = rad[:, :, inner].mean(axis=2)
        steps = []
        for frame, mean in zip(frames, of_row, strict=True):
            others = (one[:, inner].mean(axis=1) for one in (frame.node_contrast, frame.node_late_rad_per_s))
            fields = ([np.interp(v, grid.v_px, m[:, k]) for k in (0, 1)] for m in (mean, *others))
            steps.append(Steps(*(np.stack(one, axis=-1) for one in fields)))
        looked = np.interp(v, grid.v_px, shown[:, inner, 1].mean(axis=1))
        scan = (looked - looked.mean()) / max(float(np.ptp(looked)), 1e-9)
        return cls(steps, shown, bending, (rad - of_row[:, :, None]) / rad_per_px, scan)


def matvec(matrix: Float, vector: Float) -> Float:
    """Product (..., 2) of matrices (..., 2, 2) and vectors (..., 2)."""
    x, y = vector[..., 0], vector[..., 1]
    rows = (matrix[..., k, 0] * x + matrix[..., k, 1] * y for k in (0, 1))
    return np.stack(list(rows), axis=-1)
