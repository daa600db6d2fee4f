"""Sums over nodes by which the quietest of the border are found (`anchor.fit_quiet`), compiled."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask, Single
from zeromethod.rounding import REORDERED

_NEGLIGIBLE = 0.02
"""Share of the largest weight that is taken off all, down to 0."""
_TIE = 0.1
"""Length over the shortest interval's above which one counts nothing."""
_WITHIN = 1.5
"""Lengths of the core's interval outside it at which weights have fallen to 0, from 1 one length before."""


@numba.njit(cache=True, error_model="numpy")
def mask(vectors: Float, other: Float, nodes: Mask, out: Single) -> None:
    """Vectors (rows, cols, 2) on these nodes, and sums of the other (rows, cols, n); 0 elsewhere."""
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            total = other[i, j, 0]
            for k in range(1, other.shape[2]):
                total += other[i, j, k]
            there = nodes[i, j]
            out[i, j, 0] = vectors[i, j, 0] if there else 0.0
            out[i, j, 1] = vectors[i, j, 1] if there else 0.0
            out[i, j, 2] = total if there else 0.0


@numba.njit(cache=True, error_model="numpy")
def squared(means: Single, gradient: Single, multiple: float, per_share2: Single, out: Single) -> None:
    """Square (rows, cols) of slope less a multiple of the gradient, the first two of their means over blocks.

    per_share2: 1 over the square of each block's share of nodes; 0 where there is no node.
    """
    contained = np.float32(multiple)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x = means[i, j, 0] - contained * gradient[i, j, 0]
            y = means[i, j, 1] - contained * gradient[i, j, 1]
            out[i, j] = (x * x + y * y) * per_share2[i, j]


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def over_noise(slope: Float, gradient: Float, multiple: float, variance: Float, island: Mask) -> float:
    """Sum of the squares over sigma of both slopes, less a multiple of the gradient, all (rows, cols, 2)."""
    total = 0.0
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            x = slope[i, j, 0] - multiple * gradient[i, j, 0]
            y = slope[i, j, 1] - multiple * gradient[i, j, 1]
            square = x * x / variance[i, j, 0] + y * y / variance[i, j, 1]
            total += square if island[i, j] else 0.0
    return total


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def _by_slope(
    around: Single, means: Single, averaging: Float, constant: Float, scale: Float, ring: Mask, out: Float
) -> float:
    """Weights (rows, cols) of the ring's nodes by the squared slope around; the constant's mean with them."""
    total = mean = 0.0
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            slope2, noise2 = np.float64(around[i, j]), means[i, j, 2] * averaging[i, j]
            weight = scale[i, j] * scale[i, j] / (slope2 if slope2 > noise2 else noise2)
            weight = weight if ring[i, j] else 0.0
            out[i, j] = weight
            total += weight
            mean += weight * constant[i, j] if ring[i, j] else 0.0
    return mean / total


@numba.njit(cache=True, error_model="numpy")
def _farthest(constant: Float, scale: Float, mean: float, island: Mask) -> tuple[int, int]:
    """Row and column of the node whose depth is farthest from h times the mean."""
    deepest, row, col = -1.0, 0, 0
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            away = abs(scale[i, j] * (constant[i, j] - mean))
            if away > deepest and island[i, j]:
                deepest, row, col = away, i, j
    return row, col


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _divide(weights: Float, x: Float, y: Float, at: tuple[int, int], least2: float) -> float:
    """Divide weights (rows, cols) by the squared way from a node, at least least2; the largest."""
    largest, at_x, at_y = 0.0, x[at], y[at]
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            to_x, to_y, before = x[i, j] - at_x, y[i, j] - at_y, weights[i, j]
            lever2 = to_x * to_x + to_y * to_y
            weight = before / (lever2 if lever2 > least2 else least2)
            weight = weight if before > 0.0 else 0.0
            weights[i, j] = weight
            largest = weight if weight > largest else largest
    return largest


@numba.njit(cache=True, error_model="numpy")
def quiet_nodes(
    around: Single, means: Single, averaging: Float, constant: Float, scale: Float, x: Float, y: Float,
    ring: Mask, island: Mask, least2: float,
) -> tuple[Ints, Float, Float, tuple[int, int]]:  # fmt: skip
    """Flat numbers (n,) of the ring's nodes that count, their constants and weights; the deepest node.

    Weights by the squared slope around (rows, cols), at least its noise, and the way from the deepest node,
    squared, at least least2, mm^2. means, averaging: of the slopes' variance, to that of their means.
    """
    weights = np.empty(ring.shape)
    mean = _by_slope(around, means, averaging, constant, scale, ring, weights)
    at = _farthest(constant, scale, mean, island)
    least = _NEGLIGIBLE * _divide(weights, x, y, at, least2)
    flat, values = weights.reshape(ring.size), constant.reshape(ring.size)
    nodes, count = np.empty(ring.size, np.intp), 0
    for k in range(ring.size):
        # without steps, so that where a reading started does not decide which nodes count
        if flat[k] > least:
            nodes[count] = k
            count += 1
    nodes = nodes[:count]
    return nodes, values[nodes], flat[nodes] - least, at


@numba.njit(cache=True, error_model="numpy")
def shortest_interval(values: Float, weights: Float, order: Ints, share: float) -> tuple[float, float]:
    """Shortest interval of values with a share of the weight; the mean of those about as short.

    order: (n,) that sorts the values.
    """
    values, weights = values[order], weights[order]
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
def agreeing(nodes: Ints, values: Float, weights: Float, low: float, high: float, out: Float) -> float:
    """Take weight from nodes (n,) with values outside an interval; fill it in, so that it adds up to 1.

    Their mean with these weights.
    """
    reach = high - low if high > low else 1.0
    total = mean = 0.0
    for k in range(len(nodes)):
        outside = max(low - values[k], values[k] - high) / reach
        weights[k] *= min(max(_WITHIN - outside, 0.0), 1.0)
        total += weights[k]
        mean += weights[k] * values[k]
    flat = out.reshape(out.size)
    for k in range(len(nodes)):
        flat[nodes[k]] = weights[k] / total
    return mean / total


@numba.njit(cache=True, error_model="numpy")
def quiet_sums(
    nodes: Ints, weights: Float, x: Float, y: Float, at: tuple[int, int], least2: float, scale: Float,
    slope: Float, gradient: Float, multiple: float, variance: Float, slope2: Single, means: Single,
    averaging: Float,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Mean depth / h by the slope, less a multiple of the gradient, along the way from `at`; its variance.

    That is in mm^2, for nodes (n,) with noise of their own and weights (rows, cols). And the squares of slope
    and of its noise over the levers, weighted, mm^2; the sum of the squared weights.
    """
    implied = own = seen = noise = squares = 0.0
    for k in range(len(nodes)):
        i, j = nodes[k] // weights.shape[1], nodes[k] % weights.shape[1]
        w, away = weights[i, j], (x[i, j] - x[at], y[i, j] - y[at])
        for axis in range(2):
            lever = w / scale[i, j] * away[axis]
            implied -= lever * (slope[i, j, axis] - multiple * gradient[i, j, axis])
            own += lever * lever * variance[i, j, axis]
        bound2 = w * max(away[0] ** 2 + away[1] ** 2, least2) / scale[i, j] ** 2
        seen += bound2 * slope2[i, j]
        noise += bound2 * means[i, j, 2] * averaging[i, j]
        squares += w * w
    return implied, own, seen, noise, squares
