"""Sums over nodes by which the quietest of the border are found (`anchor.fit_quiet`), compiled."""

from __future__ import annotations

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.node_passes import deepest_node, diagonal

_NEGLIGIBLE = 0.02
"""Share of the largest weight that is taken off all, down to 0."""
_WITHIN = 1.5
"""Lengths of the core's interval outside it at which weights have fallen to 0, from 1 one length before."""


@numba.njit(cache=True, error_model="numpy")
def _masked(slope: Float, variance: Float, island: Mask, out: Float) -> float:
    """Both slopes, both variances and 1 where there is a node; mean square of slope over its sigma."""
    rows, cols = island.shape
    total, count = 0.0, 0
    for i in range(rows):
        for j in range(cols):
            if island[i, j]:
                count += 1
                out[i, j, 4] = 1.0
                for axis in range(2):
                    s, v = slope[i, j, axis], variance[i, j, axis]
                    out[i, j, axis], out[i, j, 2 + axis] = s, v
                    total += s * s / v
            else:
                out[i, j] = 0.0
    return total / (2 * count)


@numba.njit(cache=True, error_model="numpy")
def _squares(mean: Float, island: Mask, block: int, averaging: float, slope2: Float, noise2: Float) -> None:
    least = 1.0 / block**2
    for i in range(island.shape[0]):
        for j in range(island.shape[1]):
            share = max(mean[i, j, 4], least)
            sx, sy = mean[i, j, 0] / share, mean[i, j, 1] / share
            slope2[i, j] = sx * sx + sy * sy if island[i, j] else 0.0
            noise2[i, j] = (mean[i, j, 2] + mean[i, j, 3]) / share * averaging / share


def block_slope(
    slope: Float, variance: Float, island: Mask, averaging: float, block: int
) -> tuple[Float, Float, float]:
    """Squared slope (rows, cols) after averaging over a block, and the part of it due to noise.

    averaging: variance of a block's mean over that of its nodes. And the mean square of slope over sigma.
    """
    fields = np.empty((*island.shape, 5))
    ratio = _masked(slope, variance, island, fields)
    mean = cv2.boxFilter(fields, -1, (block, block), borderType=cv2.BORDER_CONSTANT)
    slope2, noise2 = np.empty(island.shape), np.empty(island.shape)
    _squares(np.asarray(mean, np.float64), island, block, averaging, slope2, noise2)
    return slope2, noise2, ratio


@numba.njit(cache=True, error_model="numpy")
def quiet_weights(
    spread: Float, noise2: Float, constant: Float, scale: Float, x: Float, y: Float, ring: Mask, island: Mask
) -> tuple[Float, Float, Float, Float, Float]:
    """Weights of the ring's nodes by their squared slope, at least noise2, and way from the deepest node.

    All (rows, cols). And that way (2, rows, cols), its square, at least a quarter of the island's diagonal's;
    the constants and weights (n,) of the nodes that count.
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
    # a single node has no extent and needs no weight
    floor2 = (0.25 * diagonal(x, y, island)) ** 2 or 1.0
    away = np.zeros((2, rows, cols))
    largest, count = 0.0, 0
    for i in range(rows):
        for j in range(cols):
            if ring[i, j]:
                away[0, i, j], away[1, i, j] = x[i, j] - x[at], y[i, j] - y[at]
                lever2[i, j] = max(away[0, i, j] ** 2 + away[1, i, j] ** 2, floor2)
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
    variance: Float,
    slope2: Float,
    noise2: Float,
) -> tuple[float, float, float, float, float]:
    """Mean depth / h by the slope along `away`, its variance for nodes with noise of their own, mm^2.

    And the weighted squares of slope and of its noise over the levers, mm^2; the sum of the squared weights.
    """
    implied = own = seen = noise = squares = 0.0
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            w = weights[i, j]
            if w > 0.0:
                for axis in range(2):
                    lever = w / scale[i, j] * away[axis, i, j]
                    implied -= lever * slope[i, j, axis]
                    own += lever * lever * variance[i, j, axis]
                bound2 = w * lever2[i, j] / scale[i, j] ** 2
                seen += bound2 * slope2[i, j]
                noise += bound2 * noise2[i, j]
                squares += w * w
    return implied, own, seen, noise, squares
