"""Variance of single nodes' integrated depth by the slopes' noise, exact but for the solver's error.

One node takes one solution of the integrator's equations: what leads from there to the slopes, and from them
to the noise along u and v, is worked out once for all nodes of one reading. In single precision, whose
rounding is 1e-5 of a variance.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Ints
from zeromethod.rounding import REORDERED
from zeromethod.surface.differences import (
    DERIVATIVE,
    INTEGRAL,
    INTEGRAL_POINTS,
    derivatives,
    stencils,
)
from zeromethod.surface.integrate import LinearIntegration

_SOLVED = 3e-3
"""Error of the weights with which slopes enter a depth, by which its variance is off by 0.1 %."""


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def noise_weights(
    potential: Float, across: Any, down: Any, taps: Any, by_across: Any, by_down: Any, out: Any
) -> None:
    """Weights (2, rows, cols) of the noise along u and v, of steps whose integrals are not next to a gap.

    potential: (rows, cols). across, down: weights (rows, cols-1), (rows-1, cols) of these steps. taps: half
    of the integral's weights, from outside. by_across, by_down: (2, rows, cols), from a node's derivative
    along either axis to the noise.
    """
    rows, cols = potential.shape
    line, steps = np.zeros(cols + 5, np.float32), np.zeros((rows + 5, cols), np.float32)
    far, middle, near = taps[0], taps[1], taps[2]
    for i in range(rows - 1):
        for j in range(cols):
            steps[i + 3, j] = down[i, j] * (potential[i + 1, j] - potential[i, j])
    for i in range(rows):
        for j in range(cols - 1):
            line[j + 3] = across[i, j] * (potential[i, j + 1] - potential[i, j])
        for j in range(cols):
            x = far * (line[j] + line[j + 5]) + middle * (line[j + 1] + line[j + 4])
            x += near * (line[j + 2] + line[j + 3])
            y = far * (steps[i, j] + steps[i + 5, j]) + middle * (steps[i + 1, j] + steps[i + 4, j])
            y += near * (steps[i + 2, j] + steps[i + 3, j])
            out[0, i, j] = by_across[0, i, j] * x + by_down[0, i, j] * y
            out[1, i, j] = by_across[1, i, j] * x + by_down[1, i, j] * y


@numba.njit(cache=True, error_model="numpy")
def add_next_to_gaps(
    out: Any, potential: Float, weights: Float, stencils: Ints, axis: int, table: Float, by: Any
) -> None:
    """Add the other steps along one axis; stencils: (n, 4) row, column, first node and number of nodes."""
    for i, j, first, points in stencils:
        step = weights[i, j] * (potential[i + axis, j + 1 - axis] - potential[i, j])
        at = i if axis else j
        for k in range(points):
            value = step * table[points, at - first, k]
            row, col = (first + k, j) if axis else (i, first + k)
            for noise in range(2):
                out[noise, row, col] += value * by[noise, row, col]


@numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)
def variance_of_noise(weights: Any, correlation: Any) -> float:
    """Variance of the sum of noise along u and v, of variance 1, times weights (2, rows, cols).

    correlation: (2, 2 n + 1) between nodes 0, 1, 2, ... apart along the noise's own axis and the other.
    """
    _, rows, cols = weights.shape
    far = correlation.shape[1] - 1
    line, along = np.zeros(cols + 2 * far, weights.dtype), np.zeros((rows + 2 * far, cols), weights.dtype)
    row, total = np.empty(cols, weights.dtype), 0.0
    for axis in range(2):
        across, down, own = correlation[axis], correlation[1 - axis], weights[axis]
        for i in range(rows):
            line[far : far + cols] = own[i]
            to = along[far + i]
            for j in range(cols):
                to[j] = across[0] * line[far + j]
            # two at a time, which halves the passes
            for k in range(1, far, 2):
                near, next_one = across[k], across[k + 1]
                left, right = line[far - k - 1 :], line[far + k :]
                for j in range(cols):
                    to[j] += near * (left[j + 1] + right[j]) + next_one * (left[j] + right[j + 1])
        for i in range(rows):
            for j in range(cols):
                row[j] = down[0] * along[far + i, j]
            for k in range(1, far, 2):
                near, next_one = down[k], down[k + 1]
                above, higher = along[far + i - k], along[far + i - k - 1]
                below, lower = along[far + i + k], along[far + i + k + 1]
                for j in range(cols):
                    row[j] += near * (above[j] + below[j]) + next_one * (higher[j] + lower[j])
            part = np.float64(0.0)
            for j in range(cols):
                part += row[j] * own[i, j]
            total += part
    return total


class NodeVariance:
    """Variance of depth / h at single nodes of one reading, against the mean with an anchor's weights."""

    def __init__(self, linear: LinearIntegration, factor: Float, correlation: Float, anchor: Float) -> None:
        """factor, correlation: of `SlopeNoise`."""
        self._linear, self._correlation = linear, correlation.astype(np.float32)
        self._anchor = np.where(linear.island, anchor, 0.0)
        x, y, island = (np.ascontiguousarray(one) for one in (linear.x_mm, linear.y_mm, linear.island))
        x_turned, y_turned, turned = (np.ascontiguousarray(one.T) for one in (x, y, island))
        of_across = derivatives(x, y, island, DERIVATIVE)
        of_down = derivatives(x_turned, y_turned, turned, DERIVATIVE)
        ways = of_across, [one.T for one in of_down]
        self._by = tuple(
            np.ascontiguousarray(np.einsum("ijca,cij->aij", factor, np.stack(way)), np.float32)
            for way in ways
        )
        (_, down), (_, across) = stencils(linear.island)
        self._stencils = across, down
        steps = []
        for weights, next_to_gap in zip((linear.across, linear.down), self._stencils, strict=True):
            inside = weights.astype(np.float32)
            inside[next_to_gap[:, 0], next_to_gap[:, 1]] = 0.0
            steps.append(inside)
        self._across, self._down = steps
        self._taps = INTEGRAL[INTEGRAL_POINTS, INTEGRAL_POINTS // 2 - 1, : INTEGRAL_POINTS // 2]
        self._taps = self._taps.astype(np.float32)

    def of(self, nodes: NDArray[np.intp]) -> Float:
        """Variance (n,), mm^2, at flat node numbers (n,) of the island."""
        return np.array([self._of(node) for node in nodes])

    def _of(self, node: int) -> float:
        linear, weights = self._linear, -self._anchor
        weights.reshape(-1)[node] += 1.0
        potential = linear.solution.solve(weights, _SOLVED)
        out = np.empty((2, *weights.shape), np.float32)
        of_across, of_down = self._by
        noise_weights(potential, self._across, self._down, self._taps, of_across, of_down, out)
        for axis, of_steps in enumerate((linear.across, linear.down)):
            by = self._by[axis]
            add_next_to_gaps(out, potential, of_steps, self._stencils[axis], axis, INTEGRAL, by)
        return variance_of_noise(out, self._correlation)
