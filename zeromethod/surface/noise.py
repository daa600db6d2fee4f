"""Noise of slope and depth, which independent pixels' noise reaches through overlapping windows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RBFInterpolator

from zeromethod.arrays import Float, Mask
from zeromethod.surface.integrate import LinearIntegration, SlopeIntegrator, fill_in, share_changed

_SAMPLES_PER_AXIS = 13
_AROUND = np.array([-6, -4, -2, -1, 0, 1, 2, 4, 6])
_BLURS = (3, 3), (15, 15)
_SAMPLES_AROUND_HOLES = 48
_BATCH = 32
_KEEP_SHARE = 0.05
_KEEP_FACTOR = 2.0
"""Samples are kept while the mask differs on fewer nodes than this share, and as few nodes' noise changed,
relative to all others', by more than this factor."""
_SOLVED = 1e-4
"""Relative error of the weights with which slopes enter a depth."""
_SAME_ANCHOR = 0.6
"""Share of the anchor's weight that may move to other blocks before its noise is computed again."""
_BOXES = (1, 3, 7, 15, 31, 63)
_BLOCK_SHARE = 0.1
"""Side of the blocks of which the anchor's weight is compared, relative to the lattice's shorter side."""
_EVEN = 0.02
_LEAST_LEFT = 0.02


@numba.njit(cache=True, error_model="numpy")
def _powers(variance: Float, island: Mask) -> Float:
    """Sum (rows, cols) of both variances on the island, else 0."""
    out = np.zeros(island.shape)
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            if island[i, j]:
                out[i, j] = variance[i, j, 0] + variance[i, j, 1]
    return out


@numba.njit(cache=True, error_model="numpy")
def _ratios(now: Float, kept: Float, both: Mask) -> tuple[Float, float, float]:
    """Ratio (rows, cols) on these nodes, else 0; its mean, and the mean distance from that over it."""
    out = np.zeros(both.shape)
    total = away = 0.0
    count = 0
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            if both[i, j]:
                out[i, j] = now[i, j] / kept[i, j]
                total += out[i, j]
                count += 1
    middle = total / count
    for i in range(both.shape[0]):
        for j in range(both.shape[1]):
            if both[i, j]:
                away += abs(out[i, j] - middle)
    return out, middle, away / (middle * count)


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _variance(weights: Float, factor: Float, correlation: Float) -> float:
    """Variance of sum(weights * slope), weights (rows, cols, 2); correlation: own, other of `SlopeNoise`."""
    rows, cols = weights.shape[:2]
    far = correlation.shape[1] - 1
    camera, along = np.zeros((rows, cols + 2 * far)), np.zeros((rows + 2 * far, cols))
    row, total = np.empty(cols), 0.0
    for axis in range(2):
        across, down = correlation[axis], correlation[1 - axis]
        for i in range(rows):
            for j in range(cols):
                by_x, by_y = factor[i, j, 0, axis], factor[i, j, 1, axis]
                camera[i, far + j] = by_x * weights[i, j, 0] + by_y * weights[i, j, 1]
            for j in range(cols):
                along[far + i, j] = across[0] * camera[i, far + j]
            for k in range(1, far + 1):
                for j in range(cols):
                    along[far + i, j] += across[k] * (camera[i, far + j - k] + camera[i, far + j + k])
        for i in range(rows):
            for j in range(cols):
                row[j] = down[0] * along[far + i, j]
            for k in range(1, far + 1):
                for j in range(cols):
                    row[j] += down[k] * (along[far + i - k, j] + along[far + i + k, j])
            for j in range(cols):
                total += row[j] * camera[i, far + j]
    return total


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
        factor = np.where(inside[..., None], self.factor, 0.0)
        return SlopeNoise(lambda: factor, np.where(inside, self.variance, 0.0), self.own, self.other)

    def covariance(self, weights: Float) -> Float:
        """Covariance (..., rows, cols, 2) of each slope with sum(weights * slope), weights of that shape."""
        noise, f = self._correlated(self._camera(weights)), self.factor
        u, v = noise[..., 0], noise[..., 1]
        return np.stack([f[..., 0, 0] * u + f[..., 0, 1] * v, f[..., 1, 0] * u + f[..., 1, 1] * v], axis=-1)

    def variance_of(self, weights: Float) -> Float:
        """Variance (...) of sum(weights * slope), weights (..., rows, cols, 2)."""
        out = np.empty(weights.shape[:-3])
        correlation = np.zeros((2, max(len(self.own), len(self.other))))
        correlation[0, : len(self.own)], correlation[1, : len(self.other)] = self.own, self.other
        for one in np.ndindex(out.shape):
            out[one] = _variance(np.ascontiguousarray(weights[one]), self.factor, correlation)
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


class DepthNoise:
    """Standard deviation of depth, exact at some nodes and interpolated between.

    One node's variance takes one solution of the integrator's equations and is exact: the weights with which
    all slopes enter it, times the slopes' covariance. Some 170 nodes, closer together towards the border
    where variance bends, carry a thin-plate spline of its logarithm (within 1 % of exact). They are kept
    while mask and noise keep their shape; a frame then costs a rescaling: noise at distance r reaches depth
    with weight 1 / r (the gradient of Green's function in the plane), so that every octave of r counts alike
    and what the noise has grown by is the mean of its means over boxes, octave by octave, around node and
    anchor.
    """

    def __init__(self, integrator: SlopeIntegrator) -> None:
        self._integrator = integrator
        shape = integrator.island.shape
        self._mask = np.zeros(shape, bool)
        self._power = np.zeros(shape)
        self._weightings = -1
        self._noise: SlopeNoise | None = None
        self._first = self._anchor = np.zeros(shape)
        self._sampled = self._variance = np.zeros(shape)

    def sigma(self, noise: SlopeNoise, x_mm: Float, y_mm: Float, weights: Float) -> Float:
        """Sigma (rows, cols) of depth / h, in mm, when the `weights`' mean of depth / h is taken as 0.

        noise: the reading's, at points x_mm, y_mm (rows, cols). NaN off the integrator's island.
        """
        island = self._integrator.island
        power = _powers(noise.variance, island)
        if self._noise is None or self._is_stale(power, island):
            self._sample(noise, x_mm, y_mm, weights, power)
        elif np.abs(_blocks(weights) - _blocks(self._anchor)).sum() > _SAME_ANCHOR:
            self._move_anchor(x_mm, y_mm, weights)
        found = np.sqrt(self._grown(power, island) * self._variance)
        found[~island] = np.nan
        return np.asarray(found)

    def _is_stale(self, power: Float, island: Mask) -> bool:
        if self._weightings != self._integrator.weightings:
            return True
        both = np.count_nonzero(island & self._mask)
        if both < (1.0 - _KEEP_SHARE) * np.count_nonzero(island | self._mask) or not both:
            return True
        changed = share_changed(power.ravel(), self._power.ravel(), island.ravel(), _KEEP_FACTOR**2)
        return changed > _KEEP_SHARE

    def _sample(self, noise: SlopeNoise, x_mm: Float, y_mm: Float, weights: Float, power: Float) -> None:
        island = self._integrator.island.copy()
        noise = noise.on(island)
        linear = self._integrator.linear(x_mm, y_mm)
        nodes = np.union1d(sample_nodes(island), _at_narrowest(power, island))
        variance = sampled_variance(linear, noise, nodes, weights)
        places = np.argwhere(np.ones(island.shape, bool)).astype(np.float64)
        # Nodes whose own depth is the anchor have none.
        log = np.log(np.maximum(variance, 1e-6 * variance.max(initial=1e-30)))
        if len(nodes) > 3:
            spline = RBFInterpolator(places[nodes], log, kernel="thin_plate_spline")
            self._sampled = np.exp(spline(places)).reshape(island.shape)
        else:
            self._sampled = np.full(island.shape, float(np.exp(log.mean())))
        self._noise, self._mask, self._power = noise, island, power.copy()
        self._weightings = self._integrator.weightings
        self._first = self._anchor = weights.copy()
        self._variance = self._sampled

    def _move_anchor(self, x_mm: Float, y_mm: Float, weights: Float) -> None:
        """Var(D - a D) = Var(E) - 2 Cov(E, a E) + Var(a E) with E = D - a_0 D, a_0 the samples' anchor."""
        assert self._noise is not None
        island = self._integrator.island
        first = np.where(island, self._first, 0.0)
        first /= max(float(first.sum()), 1e-30)
        linear = self._integrator.linear(x_mm, y_mm)
        slopes = self._noise.covariance(linear.slope_weights(weights - first, _SOLVED))
        row = linear.depth(slopes, _SOLVED)
        row -= (first * row).sum()
        # nodes of holes may come back while the samples are kept
        row[~island] = np.nan
        fill_in(row)
        moved = self._sampled - 2.0 * row + float((weights * row).sum())
        self._variance = np.maximum(moved, _LEAST_LEFT * self._sampled)
        self._anchor = weights.copy()

    def _grown(self, power: Float, island: Mask) -> Float | float:
        """How the variance of depth has grown since the samples, (rows, cols) or the same everywhere."""
        both = island & self._mask
        ratio, middle, uneven = _ratios(power, self._power, both)
        if uneven < _EVEN:
            return middle
        boxes = np.array([n for n in _BOXES if n <= max(ratio.shape)])
        total, margin = np.zeros(ratio.shape), int(boxes[-1] // 2)
        values, known = (
            np.asarray(cv2.integral(np.pad(one, margin)), np.float64)
            for one in (ratio, both.astype(np.float64))
        )
        _add_box_means(values, known, boxes, middle, total)
        at_anchor = float((self._anchor * total).sum() / max(float(self._anchor.sum()), 1e-30))
        return 0.5 * (total + at_anchor)


def _blocks(weights: Float) -> Float:
    """Sums over blocks: noise of depth is alike within one."""
    size = max(1, round(_BLOCK_SHARE * min(weights.shape)))
    rows, cols = (np.arange(0, count, size) for count in weights.shape)
    return np.add.reduceat(np.add.reduceat(weights, rows, axis=0), cols, axis=1)


@numba.njit(cache=True, error_model="numpy")
def _add_box_means(values: Float, known: Float, boxes: NDArray[np.intp], other: float, out: Float) -> None:
    """Add the mean of the means over boxes around each node; `other` where a box has no known node.

    values, known: sums of known values, and of their number, above and to the left, with a margin of half the
    last box.
    """
    rows, cols = out.shape
    for size in boxes:
        near = boxes[-1] // 2 - size // 2
        left, right = slice(near, near + cols), slice(near + size, near + size + cols)
        for i in range(rows):
            top, bottom = near + i, near + i + size
            a, b, c, d = values[bottom, right], values[top, right], values[bottom, left], values[top, left]
            e, f, g, h = known[bottom, right], known[top, right], known[bottom, left], known[top, left]
            for j in range(cols):
                count = e[j] - f[j] - g[j] + h[j]
                mean = (a[j] - b[j] - c[j] + d[j]) / count if count > 0.5 else other
                out[i, j] += mean / len(boxes)


def sampled_variance(
    linear: LinearIntegration, noise: SlopeNoise, nodes: NDArray[np.intp], anchor: Float
) -> Float:
    """Exact variance (n,) of depth / h, mm^2, at flat node numbers against the anchor's weighted mean."""
    found = []
    for k in range(0, len(nodes), _BATCH):
        part = nodes[k : k + _BATCH]
        weights = np.repeat(-anchor[None], len(part), axis=0)
        weights.reshape(len(part), -1)[np.arange(len(part)), part] += 1.0
        found.append(noise.variance_of(linear.slope_weights(weights, _SOLVED)))
    return np.concatenate(found) if found else np.zeros(0)


def _at_narrowest(power: Float, island: Mask) -> NDArray[np.intp]:
    """Flat numbers of island nodes where noise is most above that around: a narrow dent's bends do that."""
    known = island.astype(np.float64)
    near, wide = (
        cv2.blur(np.where(island, power, 0.0), size) / np.maximum(cv2.blur(known, size), 1e-9)
        for size in _BLURS
    )
    excess = np.where(island, near / np.maximum(wide, 1e-300), 0.0)
    row, col = np.unravel_index(int(np.argmax(excess)), island.shape)
    rows, cols = (
        (at + _AROUND)[(at + _AROUND >= 0) & (at + _AROUND < n)]
        for at, n in zip((row, col), island.shape, strict=True)
    )
    chosen = np.zeros(island.shape, bool)
    chosen[np.ix_(rows, cols)] = True
    return np.flatnonzero(chosen & island)


def sample_nodes(island: Mask) -> NDArray[np.intp]:
    """Flat numbers of island nodes on Chebyshev's points of both axes, and some along the rims of holes."""
    chosen = np.zeros(island.shape, bool)
    along = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SAMPLES_PER_AXIS)))
    rows, cols = (np.unique(np.rint((n - 1) * along).astype(np.intp)) for n in island.shape)
    chosen[np.ix_(rows, cols)] = True
    rim = island & ~ndimage.binary_erosion(island, border_value=1)
    on_rim = np.flatnonzero(rim)
    step = max(len(on_rim) // _SAMPLES_AROUND_HOLES, 1)
    chosen.ravel()[on_rim[::step]] = True
    return np.flatnonzero(chosen & island)
