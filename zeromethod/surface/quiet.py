"""Sums over nodes by which the quietest of the border are found (`anchor.fit_quiet`), compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.surface.node_passes import deepest_node

_NEGLIGIBLE = 0.02
"""Share of the largest weight that is taken off all, down to 0."""
_TIE = 0.1
"""Length over the shortest interval's above which one counts nothing."""
_WITHIN = 1.5
"""Lengths of the core's interval outside it at which weights have fallen to 0, from 1 one length before."""


@numba.njit(cache=True, error_model="numpy")
def mask(one: Float, other: Float, nodes: Mask, out: Single) -> None:
    """Both (rows, cols, n), (rows, cols, m) on these nodes, else 0, one after the other."""
    first = one.shape[2]
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            if nodes[i, j]:
                for k in range(first):
                    out[i, j, k] = one[i, j, k]
                for k in range(first, out.shape[2]):
                    out[i, j, k] = other[i, j, k - first]
            else:
                out[i, j] = 0.0


@numba.njit(cache=True, error_model="numpy")
def noise_of(means: Single, averaging: Float) -> Float:
    """Variance (rows, cols) of a block's slope: both variances, third and fourth of its means, averaged."""
    rows, cols = averaging.shape
    out = np.empty((rows, cols))
    for i in range(rows):
        for j in range(cols):
            out[i, j] = (means[i, j, 2] + means[i, j, 3]) * averaging[i, j]
    return out


@numba.njit(cache=True, error_model="numpy")
def squared(means: Single, gradient: Single, multiple: float, block: int, island: Mask) -> Float:
    """Square of slope less a multiple of the gradient, each the first two of its means over blocks; else 0.

    The gradient's third is the share of each block that has nodes.
    """
    least, out = 1.0 / block**2, np.empty(island.shape)
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            x = means[i, j, 0] - multiple * gradient[i, j, 0]
            y = means[i, j, 1] - multiple * gradient[i, j, 1]
            share = max(gradient[i, j, 2], least)
            out[i, j] = (x * x + y * y) / (share * share) if island[i, j] else 0.0
    return out


@numba.njit(cache=True, error_model="numpy")
def over_noise(slope: Float, gradient: Float, multiple: float, variance: Float, island: Mask) -> float:
    """Mean square over sigma of both slopes, less a multiple of the gradient, all (rows, cols, 2)."""
    total, count = 0.0, 0
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            if island[i, j]:
                count += 1
                for k in range(2):
                    total += (slope[i, j, k] - multiple * gradient[i, j, k]) ** 2 / variance[i, j, k]
    return total / (2 * count)


@numba.njit(cache=True, error_model="numpy")
def quiet_weights(
    spread: Float, noise2: Float, constant: Float, scale: Float, x: Float, y: Float, ring: Mask, island: Mask,
    least2: float,
) -> tuple[Float, Float, Float, Float, Float]:  # fmt: skip
    """Weights of the ring's nodes by their squared slope, at least noise2, and way from the deepest node.

    All (rows, cols). And that way (2, rows, cols), its square, at least `least2`, mm^2; the constants and
    weights (n,) of the nodes that count.
    """
    weights, lever2 = np.zeros(ring.shape), np.zeros(ring.shape)
    rows, cols = ring.shape
    total = mean = 0.0
    for i in range(rows):
        for j in range(cols):
            if ring[i, j]:
                weights[i, j] = scale[i, j] ** 2 / max(spread[i, j], noise2[i, j])
                total += weights[i, j]
                mean += weights[i, j] * constant[i, j]
    at = deepest_node(scale * (constant - mean / total), island)
    away = np.zeros((2, rows, cols))
    largest, count = 0.0, 0
    for i in range(rows):
        for j in range(cols):
            if ring[i, j]:
                away[0, i, j], away[1, i, j] = x[i, j] - x[at], y[i, j] - y[at]
                lever2[i, j] = max(away[0, i, j] ** 2 + away[1, i, j] ** 2, least2)
                weights[i, j] /= lever2[i, j]
                largest = max(largest, weights[i, j])
    values, heavy = np.empty(ring.size), np.empty(ring.size)
    for i in range(rows):
        for j in range(cols):
            # without steps, so that where a reading started does not decide which nodes count
            weights[i, j] = max(weights[i, j] - _NEGLIGIBLE * largest, 0.0)
            if weights[i, j] > 0.0:
                values[count], heavy[count] = constant[i, j], weights[i, j]
                count += 1
    return weights, away, lever2, values[:count], heavy[:count]


@numba.njit(cache=True, error_model="numpy")
def shortest_interval(values: Float, weights: Float, share: float) -> tuple[float, float]:
    """Shortest interval of values, in order, with a share of the weight; the mean of those about as short."""
    first, last = np.empty(len(values)), np.empty(len(values))
    total = weights.sum() * (1.0 - 1e-12)
    end, inside, shortest, fits = 0, 0.0, np.inf, 0
    for k in range(len(values)):
        while end < len(values) and inside < share * total:
            inside += weights[end]
            end += 1
        if inside < share * total:
            break
        fits += 1
        first[k], last[k] = values[k], values[end - 1]
        shortest = min(shortest, last[k] - first[k])
        inside -= weights[k]
    low = high = count = 0.0
    for k in range(fits):
        longer = last[k] - first[k] - shortest
        # one among many that are about as short would change with the last digit
        near = weights[k] * max(1.0 - longer / (_TIE * shortest), 0.0) if longer > 0.0 else weights[k]
        if near > 0.0:
            low, high, count = low + near * first[k], high + near * last[k], count + near
    return low / count, high / count


@numba.njit(cache=True, error_model="numpy")
def agreeing(weights: Float, constant: Float, low: float, high: float) -> None:
    """Take weight from nodes outside an interval of the constant; then they add up to 1."""
    reach = high - low if high > low else 1.0
    total = 0.0
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            if weights[i, j] > 0.0:
                outside = max(low - constant[i, j], constant[i, j] - high) / reach
                weights[i, j] *= min(max(_WITHIN - outside, 0.0), 1.0)
                total += weights[i, j]
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            weights[i, j] /= total


@numba.njit(cache=True, error_model="numpy")
def quiet_sums(
    weights: Float,
    away: Float,
    lever2: Float,
    scale: Float,
    slope: Float,
    gradient: Float,
    multiple: float,
    variance: Float,
    slope2: Float,
    noise2: Float,
) -> tuple[float, float, float, float, float]:
    """Mean depth / h by the slope, less a multiple of the gradient, along `away`; its variance, mm^2.

    That is for nodes with noise of their own. And the weighted squares of slope and of its noise over the
    levers, mm^2; the sum of the squared weights.
    """
    implied = own = seen = noise = squares = 0.0
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            w = weights[i, j]
            if w > 0.0:
                for axis in range(2):
                    lever = w / scale[i, j] * away[axis, i, j]
                    implied -= lever * (slope[i, j, axis] - multiple * gradient[i, j, axis])
                    own += lever * lever * variance[i, j, axis]
                bound2 = w * lever2[i, j] / scale[i, j] ** 2
                seen += bound2 * slope2[i, j]
                noise += bound2 * noise2[i, j]
                squares += w * w
    return implied, own, seen, noise, squares
