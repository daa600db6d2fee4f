"""The residual: displacement of the observed picture against the target per node, with sigma and flags."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Flags, Float, Ints, Mask, Single
from zeromethod.rig.model import Noise
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag

MODULATION, SATURATED, LIGHT_LOST = int(Flag.MODULATION), int(Flag.SATURATED), int(Flag.LIGHT_LOST)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits beyond which a node is flagged.

    sigma_periods: largest standard deviation of d, in periods. visibility: smallest carrier amplitude
    over mean light. clipped_share: largest share of the window's pixels at the ceiling. light_share:
    smallest mean light over that of the reference.
    """

    sigma_periods: float = 1 / 32
    visibility: float = 0.03
    clipped_share: float = 0.01
    light_share: float = 0.3


class Scales(NamedTuple):
    """Camera noise and limits in the units of residuals; see `Limits`.

    still: variance without light, grey^2. per_grey: light's variance per grey. black: grey without light.
    clipped: pixels of a window.
    """

    still: float
    per_grey: float
    black: float
    sigma_px: float
    visibility: float
    clipped: float
    light_share: float

    @classmethod
    def of(cls, noise: Noise, limits: Limits, period_px: int) -> Scales:
        """Scales of a camera for windows of +-`period_px`."""
        return cls(
            still=noise.read_grey**2 + 1 / 12,
            per_grey=0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey,
            black=noise.black_grey,
            sigma_px=limits.sigma_periods * period_px,
            visibility=limits.visibility,
            clipped=limits.clipped_share * (2 * period_px) ** 2,
            light_share=limits.light_share,
        )


def flags_of(
    sigma: Float | Single,
    amplitude: Float | Single,
    light: Float | Single,
    rest: Single,
    clipped: Ints | int,
    scales: Scales,
) -> Flags:
    """Flags of nodes by their larger sigma, smaller amplitude, mean light, light at rest, clipped pixels.

    Arrays (rows, cols); clipped: or 0, for all nodes.
    """
    weak = ~(sigma <= scales.sigma_px) | (amplitude < scales.visibility * light)
    flags: Flags = weak * np.uint16(MODULATION)
    flags |= (light < scales.light_share * rest) * np.uint16(LIGHT_LOST)
    if np.any(clipped):
        flags |= np.greater(clipped, scales.clipped) * np.uint16(SATURATED)
    return flags


@dataclass(frozen=True, slots=True)
class Residual:
    """Displacement per node of a `NodeGrid`, padding included.

    Convention: observed(u, v) = target((u, v) + d), so the LCD point observed at (u, v) is the one shown
    at (u, v) + d; d = (du, dv) in camera px. (Optical flow would be -d.)

    d: (rows, cols, 2) float64; 0 where OUTSIDE, meaningless where flagged.
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
        """(rows, cols) nodes without a flag."""
        return np.equal(self.flags, 0)

    @property
    def arrays(self) -> tuple[Float, Float, Flags, Single, Single]:
        """(d, sigma, flags, modulation, mean)."""
        return self.d, self.sigma, self.flags, self.modulation, self.mean

    @classmethod
    def empty(cls, grid: NodeGrid) -> Residual:
        """Residual of a grid with all nodes OUTSIDE; `measure` fills the measurable nodes only."""
        rows, cols = grid.shape
        return cls(
            d=np.zeros((rows, cols, 2)),
            sigma=np.full((rows, cols, 2), np.inf),
            flags=np.full((rows, cols), Flag.OUTSIDE, np.uint16),
            modulation=np.zeros((rows, cols, 2), np.float32),
            mean=np.zeros((rows, cols), np.float32),
        )

    def copy(self) -> Residual:
        """Copy of all arrays, safe from the sensor's next measurement."""
        d, sigma, flags, modulation, mean = self.arrays
        return Residual(d.copy(), sigma.copy(), flags.copy(), modulation.copy(), mean.copy())
