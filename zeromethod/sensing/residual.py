"""The residual: per node, how far what was seen is from the target, how sure, and why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag


@dataclass(frozen=True, slots=True)
class Limits:
    """When a node is not to be trusted.

    sigma_periods: largest standard deviation of d, in periods. visibility: smallest carrier amplitude
    over mean light. clipped_share: largest share of the window's pixels at the ceiling. light_share:
    smallest mean light over that of the reference.
    """

    sigma_periods: float = 1 / 32
    visibility: float = 0.03
    clipped_share: float = 0.01
    light_share: float = 0.3


@dataclass(frozen=True, slots=True)
class Residual:
    """Displacement per node of a `NodeGrid`, padding included.

    Convention: observed(u, v) = target((u, v) + d), so the LCD point seen at (u, v) is the one shown at
    (u, v) + d; d = (du, dv) in camera px. (Image motion as optical flow has it is -d.)

    d: (rows, cols, 2) float64; 0 where OUTSIDE, not to be used where flagged.
    sigma: (rows, cols, 2) float64, standard deviation of d, px; infinite where OUTSIDE or no carrier.
    flags: (rows, cols) uint16 of `Flag` bits; 0 = valid.
    modulation: (rows, cols, 2) float32, carrier amplitude of each component, grey levels.
    mean: (rows, cols) float32, mean grey in the window, black level included.
    """

    d: Float
    sigma: Float
    flags: Flags
    modulation: Single
    mean: Single

    @property
    def valid(self) -> Mask:
        """(rows, cols) nodes that may be trusted."""
        return np.equal(self.flags, 0)

    @classmethod
    def empty(cls, grid: NodeGrid) -> Residual:
        """Buffers for a grid: everything OUTSIDE. `measure` fills the measurable nodes only."""
        rows, cols = grid.shape
        return cls(
            d=np.zeros((rows, cols, 2)),
            sigma=np.full((rows, cols, 2), np.inf),
            flags=np.full((rows, cols), Flag.OUTSIDE, np.uint16),
            modulation=np.zeros((rows, cols, 2), np.float32),
            mean=np.zeros((rows, cols), np.float32),
        )

    def copy(self) -> Residual:
        """Arrays of its own, safe from the sensor's next measurement."""
        return Residual(
            self.d.copy(), self.sigma.copy(), self.flags.copy(), self.modulation.copy(), self.mean.copy()
        )
