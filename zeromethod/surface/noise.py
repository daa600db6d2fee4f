"""Noise of slope and depth, which independent pixels' noise reaches through overlapping windows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy import ndimage

from zeromethod.arrays import Float, Mask
from zeromethod.surface.integrate import SlopeIntegrator, fill_in, share_changed
from zeromethod.surface.node_variance import variance_of_noise
from zeromethod.surface.noise_growth import Known, grown_by
from zeromethod.surface.samples import A_FEW, AT_FIRST, SELDOM, Samples

_KEEP_SHARE, _KEEP_BACK, _KEEP_CHANGED = 0.02, 0.005, 0.05
_KEEP_FACTOR = 2.0
"""Samples are kept while the mask differs on fewer nodes than the first share, fewer than the second came
back, and on fewer than the third noise changed, relative to all others', by more than this factor."""
_SOLVED = 1e-4
"""Relative error of the weights with which slopes enter a depth."""
_SAME_ANCHOR = 0.6
"""Share of the anchor's weight that may move to other blocks before its noise is computed again."""
_BLOCK_SHARE = 0.1
"""Side of the blocks of which the anchor's weight is compared, relative to the lattice's shorter side."""
_LEAST_LEFT = 0.02
_MOST_GUESSES = 4
"""Masks in turn that go by another one's samples."""


def _powers(variance: Float, island: Mask) -> Float:
    """Sum (rows, cols) of both variances on the island, else 0."""
    return np.where(island, variance[..., 0] + variance[..., 1], 0.0)


class SlopeNoise:
    """Noise of the slopes of one reading.

    factor: (rows, cols, 2, 2), slope's error = factor @ (noise along u, along v), each of variance 1.
    own, other: correlation of that noise between nodes 0, 1, 2, ... apart along its own axis and the other.
    variance: (rows, cols, 2) rad^2.
    """

    def __init__(self, make_factor: Callable[[], Float], variance: Float, own: Float, other: Float) -> None:
        """make_factor: called when the factor is first asked for; most readings need the variance alone."""
        self._make_factor = make_factor
        self.variance, self.own, self.other = variance, own, other

    @cached_property
    def factor(self) -> Float:
        """(rows, cols, 2, 2) rad."""
        return self._make_factor()

    def on(self, island: Mask) -> SlopeNoise:
        """The same on an island (rows, cols), none elsewhere."""
        inside = island[..., None]
        variance = np.where(inside, self.variance, 0.0)
        return SlopeNoise(
            lambda: np.where(inside[..., None], self.factor, 0.0), variance, self.own, self.other
        )

    def covariance(self, weights: Float) -> Float:
        """Covariance (..., rows, cols, 2) of each slope with sum(weights * slope), weights of that shape."""
        noise, f = self._correlated(self._camera(weights)), self.factor
        u, v = noise[..., 0], noise[..., 1]
        return np.stack([f[..., 0, 0] * u + f[..., 0, 1] * v, f[..., 1, 0] * u + f[..., 1, 1] * v], axis=-1)

    def variance_of(self, weights: Float) -> Float:
        """Variance (...) of sum(weights * slope), weights (..., rows, cols, 2)."""
        out = np.empty(weights.shape[:-3])
        for one in np.ndindex(out.shape):
            camera = np.ascontiguousarray(np.moveaxis(self._camera(weights[one]), -1, 0))
            out[one] = variance_of_noise(camera, self.correlation)
        return out

    @property
    def correlation(self) -> Float:
        """(2, 2 n + 1) own and other, 0 beyond their ends."""
        out = np.zeros((2, 2 * (max(len(self.own), len(self.other)) // 2) + 1))
        out[0, : len(self.own)], out[1, : len(self.other)] = self.own, self.other
        return out

    def _camera(self, weights: Float) -> Float:
        """Weights (..., rows, cols, 2) of the noise along u and v from those of the slopes."""
        x, y, f = weights[..., 0], weights[..., 1], self.factor
        return np.stack([f[..., 0, 0] * x + f[..., 1, 0] * y, f[..., 0, 1] * x + f[..., 1, 1] * y], axis=-1)

    def _correlated(self, weights: Float) -> Float:
        out = np.empty_like(weights)
        own, other = (np.concatenate([c[:0:-1], c]) for c in (self.own, self.other))
        for axis, (across, down) in enumerate(((own, other), (other, own))):
            once = ndimage.correlate1d(weights[..., axis], across, axis=-1, mode="constant")
            out[..., axis] = ndimage.correlate1d(once, down, axis=-2, mode="constant")
        return out


class _Map:
    """Variance of depth by the samples of one mask and set of weights, rescaled while these are kept."""

    def __init__(
        self,
        integrator: SlopeIntegrator,
        noise: SlopeNoise,
        power: Float,
        x_mm: Float,
        y_mm: Float,
        weights: Float,
        earlier: _Map | None,
    ) -> None:
        """Begin samples, for this reading's mask and noise; arguments as of `DepthNoise.variance`, `Samples`.

        earlier: that of another mask, which says what the rough variance is off by.
        """
        island = integrator.island.copy()
        self._noise = noise = noise.on(island)
        # weights are kept from other noise
        kept = _powers(integrator.variance, island)
        both = island & (kept > 0.0)
        grown = grown_by(power, kept, both, Known.of(both), weights)
        linear = integrator.linear(x_mm, y_mm)
        self._samples: Samples | None = Samples(
            linear, lambda: noise.factor, noise.correlation, power, weights, grown,
            None if earlier is None else earlier.off, None if earlier is None else earlier.mask,
        )  # fmt: skip
        self.off: Float | None = None if earlier is None else earlier.off
        self._guesses: int = 0 if earlier is None or earlier.sampled else earlier._guesses + 1
        self.mask: Mask = island
        self._power, self._weighting = power.copy(), integrator.weighting
        self._first = self._anchor = weights.copy()
        self._blocks = _blocks(weights, _block_size(island.shape))
        self._both, self._known = island, Known.of(island)
        self._sampled = self._variance = np.zeros(island.shape)
        self._shift: Float | float = 0.0
        self._readings = 0

    @property
    def sampled(self) -> bool:
        """Whether samples of its own were taken."""
        return self._samples is None or self._samples.taken > 0

    def fits(self, power: Float, island: Mask, weighting: int) -> bool:
        """Whether it may be kept for this mask and noise."""
        if self._weighting != weighting:
            return False
        both, all_nodes = (np.count_nonzero(one) for one in (island & self.mask, island | self.mask))
        if both < (1.0 - _KEEP_SHARE) * all_nodes or not both:
            return False
        if np.count_nonzero(island & ~self.mask) > _KEEP_BACK * all_nodes:
            return False
        changed = share_changed(power.ravel(), self._power.ravel(), island.ravel(), _KEEP_FACTOR**2)
        return bool(changed <= _KEEP_CHANGED)

    def variance(self, power: Float, island: Mask) -> Float:
        """Variance (rows, cols) of depth / h, mm^2, by the noise of this reading."""
        both = island & self.mask
        if not np.array_equal(both, self._both):
            self._both, self._known = both, Known.of(both)
        out = grown_by(power, self._power, both, self._known, self._anchor) * self._variance
        out[~island] = np.nan
        return np.asarray(out)

    def take(self, at_once: bool) -> None:
        """Work out some samples more, or all; the map is made before them, with the first few, and with all.

        In the reading with which it begins none are, where another mask's are known; of masks that change
        from reading to reading every few ones are.
        """
        samples = self._samples
        if samples is None:
            return
        made, before = self._variance.any(), samples.stage
        self._readings += 1
        if at_once or not made:
            if at_once or self.off is None or self._guesses >= _MOST_GUESSES:
                samples.take(None if at_once else AT_FIRST)
        elif before == 0 or self._readings % SELDOM == 0:
            samples.take(A_FEW if before == 0 else 1)
        if not made or before == 0 or samples.stage > before:
            self._sampled = samples.variance()
            self.off = samples.off
            self._shifted()
        if samples.complete:
            self._samples = None

    def _shifted(self) -> None:
        self._variance = np.maximum(self._sampled + self._shift, _LEAST_LEFT * self._sampled)

    def move_anchor(self, integrator: SlopeIntegrator, x_mm: Float, y_mm: Float, weights: Float) -> None:
        """Follow the anchor where much of its weight has moved.

        Var(D - a D) = Var(E) - 2 Cov(E, a E) + Var(a E) with E = D - a_0 D, a_0 the samples' anchor.
        """
        blocks = _blocks(weights, _block_size(weights.shape))
        if not np.abs(blocks - self._blocks).sum() > _SAME_ANCHOR:
            return
        island = integrator.island
        first = np.where(island, self._first, 0.0)
        first /= max(float(first.sum()), 1e-30)
        linear = integrator.linear(x_mm, y_mm)
        slopes = self._noise.covariance(linear.slope_weights(weights - first, _SOLVED))
        row = linear.depth(slopes, _SOLVED)
        row -= (first * row).sum()
        # nodes of holes may come back while the samples are kept
        row[~island] = np.nan
        fill_in(row)
        self._shift = float((weights * row).sum()) - 2.0 * row
        self._anchor, self._blocks = weights.copy(), blocks
        self._shifted()


class DepthNoise:
    """Variance of depth, exact at some nodes and interpolated between.

    One node's variance takes one solution of the integrator's equations (`NodeVariance`). Over the rough one
    of the lattices (`log_rough_variance`) it varies slowly: its logarithm is a thin-plate spline through some
    220 nodes, closer together towards the border and around the narrowest dent. That is within 1 % rms of
    sigma, and within a third at single nodes of holes' rims, whose noise is their own. Where readings follow
    each other, the samples of a new mask or new weights are worked out one or two at a time: the first
    reading goes by the rough variance and by what that was off before (for another mask on the safe side,
    mostly 10 to 25 % more than sigma; for new weights alone within 3 % rms), the next ones by what the first
    samples are off besides, on the mean, which leaves 2 % of it after four; after eight by how 16 nodes all
    over the view changed that; then the others, in 600 readings. Samples are kept while mask and
    noise keep their shape, and for a mask that comes back, as a dent hides nodes while it moves; a frame then
    costs a rescaling: noise at distance r reaches depth with weight 1 / r (the gradient of Green's function
    in the plane), so that every octave of r counts alike and what the noise has grown by is the mean of its
    means over boxes, octave by octave, around node and anchor.
    """

    def __init__(self, integrator: SlopeIntegrator) -> None:
        self._integrator = integrator
        self._map: _Map | None = None
        self._earlier: _Map | None = None

    def variance(
        self, noise: SlopeNoise, x_mm: Float, y_mm: Float, weights: Float, at_once: bool = True
    ) -> Float:
        """Variance (rows, cols) of depth / h, in mm^2, when the `weights`' mean of depth / h is taken as 0.

        noise: the reading's, at points x_mm, y_mm (rows, cols). at_once: False where a few samples at a time
        will do. NaN off the integrator's island.
        """
        integrator, island = self._integrator, self._integrator.island
        power = _powers(noise.variance, island)
        like = power, island, integrator.weighting
        kept = next((one for one in (self._map, self._earlier) if one is not None and one.fits(*like)), None)
        if kept is None or kept is self._earlier:
            self._earlier = self._map
        if kept is None:
            kept = _Map(integrator, noise, power, x_mm, y_mm, weights, self._earlier)
        else:
            kept.move_anchor(integrator, x_mm, y_mm, weights)
        self._map = kept
        self._map.take(at_once)
        return self._map.variance(power, island)


def _block_size(shape: tuple[int, ...]) -> int:
    return max(1, round(_BLOCK_SHARE * min(shape)))


def _blocks(weights: Float, size: int) -> Float:
    """Sums over blocks: noise of depth is alike within one."""
    rows, cols = (np.arange(0, n, size) for n in weights.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(weights, rows, axis=0), cols, axis=1))
