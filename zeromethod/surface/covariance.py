"""Full covariance of a reading's depth; the matrix is never formed.

Depth is, to first order, a linear function of the slopes' errors: D = h (1 - 1 a^T) A^-1 B s, with B the
weighted sums of node-to-node steps, A their normal matrix (see `integrate`), a the anchor's weights and h the
scale. The slopes' errors are s = F n, n the residual's noise with correlation R (`zeromethod.warp.overlap`).
Any product with Cov(D) = M R M^T, M = h (1 - 1 a^T) A^-1 B F, is one pass back through M^T and one forth
through M: two solutions on lattices that exist already.

The anchor's weights a are taken as given. Where a rectangle is known to be at rest they are, and the stated
covariance is exact: sigmas of means over patches agree with 4000 draws of the noise within the 3 % that so
many draws allow. Where the frame chose its quietest nodes, a depends on the noise: a third of the weight lies
elsewhere in the next frame. Depths of the anchor's own nodes, whose noise is the smallest of all (30 nm where
others have 80, on the packaged bench binned by 4), then have heavier tails than a Gaussian's (excess kurtosis
1). The stated sigma of a mean over 7 x 7 of them differs by 16 % (rms) from frame to frame, and its rms is
6 % too small to 4 % too large (13 % on a mirror at rest, whose anchor spreads over more of the border). Nodes
off the anchor are not affected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.noise import SlopeNoise
from zeromethod.warp.grid import NodeGrid

_ROUNDING = 1e-12
"""Difference of weights below which they are the same, relative."""


@dataclass(frozen=True, slots=True)
class Variance:
    """Variance of a linear functional of depth, mm^2 (times the weights' unit squared).

    noise: of this one frame; another frame's is independent. anchor: what is not known about the depth of the
    nodes taken as known; much the same in every frame with that anchor (the noise of a far field that is
    followed counts here too, and before the null what the sensing window hides). geometry: what the rig's
    geometry leaves open (`GeometrySpec`), the same in every frame.
    """

    noise: float
    anchor: float
    geometry: float = 0.0

    @property
    def total(self) -> float:
        """All together; they are independent."""
        return self.noise + self.anchor + self.geometry

    @property
    def sigma(self) -> float:
        """Standard deviation, mm."""
        return float(np.sqrt(max(self.total, 0.0)))


@dataclass(frozen=True, slots=True)
class Covariances:
    """Covariance of every node's depth with one sum over depths, (rows, cols) mm^2; see `Variance`."""

    noise: Float
    anchor: Float
    geometry: Float

    @property
    def total(self) -> Float:
        """All together."""
        return self.noise + self.anchor + self.geometry


class DepthCovariance:
    """Covariance of the depths of one `Surface`; from `SurfaceReader.covariance`.

    Arrays are on the full `NodeGrid`; weights count on valid nodes only, results are NaN elsewhere. Every
    method costs two solutions at most (about 5 ms at 125 x 157 nodes). Exact to first order in the noise, for
    the anchor's weights as this frame has them (see the module).
    """

    def __init__(
        self,
        grid: NodeGrid,
        linear: LinearIntegration,
        noise: SlopeNoise,
        scale: Float,
        anchor: Float,
        systematic_mm: Float,
        geometry_mm: Float,
    ) -> None:
        """Scale h, anchor's weights: (rows, cols) of the measurable nodes.

        systematic_mm, geometry_mm: (n, rows, cols) independent errors of depth by the anchor and by what the
        geometry leaves open, one sigma of each: they are the same in every frame.
        """
        self._grid, self._linear, self._noise = grid, linear, noise
        self._scale, self._anchor = scale, anchor
        self._systematic, self._geometry = systematic_mm, geometry_mm

    def variance_of(self, weights: Float) -> Variance:
        """Variance of sum(weights * depth).

        weights: (rows, cols). Raises InputError on another shape or weights that are not finite.
        """
        inner = self._checked(weights)
        noise = float(self._noise.variance_of(self._slope_weights(inner)))
        anchor, geometry = (float((share**2).sum()) for share in self._shares(inner))
        return Variance(noise, anchor, geometry)

    def with_mean(self, weights: Float) -> Covariances:
        """Covariance of every depth with sum(weights * depth), weights (rows, cols)."""
        inner = self._checked(weights)
        row = self._linear.depth(self._noise.covariance(self._slope_weights(inner)))
        row -= float((self._anchor * row).sum())
        anchor, geometry = self._shares(inner)
        systematic = np.tensordot(anchor, self._systematic, axes=1)
        modes = np.tensordot(geometry, self._geometry, axes=1)
        return Covariances(*(self._padded(one) for one in (self._scale * row, systematic, modes)))

    def _shares(self, inner: Float) -> tuple[Float, Float]:
        """What each error makes of the weighted sum: by the anchor, by the geometry."""
        anchor, geometry = (np.tensordot(one, inner, 2) for one in (self._systematic, self._geometry))
        return anchor, geometry

    def _slope_weights(self, inner: Float) -> Float:
        in_units_of_h = inner * self._scale
        left = in_units_of_h - in_units_of_h.sum() * self._anchor
        # the anchor's own mean is no sum of slopes, and rounding none to solve for
        left[np.abs(left) < _ROUNDING * np.abs(in_units_of_h).max(initial=0.0)] = 0.0
        return self._linear.slope_weights(left) if left.any() else np.zeros((*left.shape, 2))

    def _checked(self, weights: Float) -> Float:
        weights = np.asarray(weights, dtype=np.float64)
        if weights.shape != self._grid.shape or not np.isfinite(weights).all():
            raise InputError(f"weights: shape {weights.shape}: finite numbers of shape {self._grid.shape}")
        return np.where(self._linear.island, weights[self._grid.inner], 0.0)

    def _padded(self, inner: Float) -> Float:
        return self._grid.padded(np.where(self._linear.island, inner, np.nan), np.nan)
