"""Variance of single nodes' integrated depth by the slopes' noise, exact but for the solver's error.

One node takes one solution of the integrator's equations: what leads from there to the slopes, and from them
to the noise along u and v, is worked out once for all nodes of one reading. In single precision, whose
rounding is 1e-5 of a variance.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from zeromethod.arrays import Float, Ints, Single
from zeromethod.kernels import kernel, read
from zeromethod.rounding import REORDERED
from zeromethod.surface.differences import (
    INTEGRAL,
    INTEGRAL_POINTS,
    derivatives,
    stencils,
)
from zeromethod.surface.integrate import LinearIntegration

_SOLVED = 3e-3
"""Error of the weights with which slopes enter a depth, by which its variance is off by 0.1 %."""


@kernel(
    read(numba.float64, 2), read(numba.float32, 2), read(numba.float32, 2), read(numba.float32, 1),
    read(numba.float32, 3), read(numba.float32, 3), numba.float32[::1], numba.float32[:, ::1],
    numba.float32[:, :, ::1], fastmath=REORDERED,
)  # fmt: skip
def _noise_weights(
    potential: Float,
    across: Single,
    down: Single,
    taps: Single,
    by_across: Single,
    by_down: Single,
    line: Single,
    steps: Single,
    out: Single,
) -> None:
    """Weights (2, rows, cols) of the noise along u and v, of steps whose integrals are not next to a gap.

    potential: (rows, cols). across, down: weights (rows, cols-1), (rows-1, cols) of these steps. taps: half
    of the integral's weights, from outside. by_across, by_down: (2, rows, cols), from a node's derivative
    along either axis to the noise. line, steps: (cols + 5,), (rows + 5, cols) to work with, 0 at first.
    """
    rows, cols = potential.shape
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


@kernel(
    read(numba.float32, 3), read(numba.float32, 2), numba.float32[::1], numba.float32[:, ::1],
    fastmath=REORDERED,
)  # fmt: skip
def _variance_of_noise(weights: Single, correlation: Single, line: Single, along: Single) -> float:
    """As `variance_of_noise`; line, along: (cols + 2 far,), (rows + 2 far, cols) to work with, 0 at first."""
    _, rows, cols = weights.shape
    far, total = correlation.shape[1] - 1, 0.0
    for axis in range(2):
        across, down, own = correlation[axis], correlation[1 - axis], weights[axis]
        for i in range(rows):
            to, first, whole = along[far + i], across[0], own[i]
            for j in range(cols):
                line[far + j] = whole[j]
                to[j] = first * whole[j]
            # two at a time, which halves the passes
            for k in range(1, far, 2):
                near, next_one = across[k], across[k + 1]
                left, right = line[far - k - 1 :], line[far + k :]
                for j in range(cols):
                    to[j] += near * (left[j + 1] + right[j]) + next_one * (left[j] + right[j + 1])
        row = line[far : far + cols]
        for i in range(rows):
            first, middle, whole = down[0], along[far + i], own[i]
            for j in range(cols):
                row[j] = first * middle[j]
            for k in range(1, far, 2):
                near, next_one = down[k], down[k + 1]
                above, higher = along[far + i - k], along[far + i - k - 1]
                below, lower = along[far + i + k], along[far + i + k + 1]
                for j in range(cols):
                    row[j] += near * (above[j] + below[j]) + next_one * (higher[j] + lower[j])
            part = np.float64(0.0)
            for j in range(cols):
                part += row[j] * whole[j]
            total += part
    return total


def variance_of_noise(weights: Float | Single, correlation: Float | Single) -> float:
    """Variance of the sum of noise along u and v, of variance 1, times weights (2, rows, cols).

    correlation: (2, 2 n + 1) between nodes 0, 1, 2, ... apart along the noise's own axis and the other.
    """
    _, rows, cols = weights.shape
    margins = 2 * (correlation.shape[1] - 1)
    line, along = np.zeros(cols + margins, np.float32), np.zeros((rows + margins, cols), np.float32)
    return float(_variance_of_noise(weights, correlation, line, along))


class _NextToGaps:
    """What steps next to gaps along one axis add to the weights of the noise."""

    def __init__(self, weights: Float, stencils: Ints, axis: int, by: Single) -> None:
        """Arguments: of all steps; (n, 4) row, column, first node, number of nodes; 1 along columns, else 0.

        by: (2, rows, cols), from a node's derivative to the noise.
        """
        row, col, first, points = (one[:, None] for one in stencils.T)
        node = np.arange(INTEGRAL.shape[-1])
        there = node < points
        value = INTEGRAL[points, (row if axis else col) - first, node] * weights[row, col]
        ends = np.broadcast_arrays(*((first + node, col) if axis else (row, first + node)))
        to, of = np.ravel_multi_index([one[there] for one in ends], by.shape[1:]), there.nonzero()[0]
        self._nodes, where = np.unique([to, to + by[0].size], return_inverse=True)
        value = by.reshape(2, -1)[:, to] * value[there]
        numbers = where.ravel(), np.tile(of, 2)
        self._values = sparse.csr_array((value.ravel(), numbers), shape=(len(self._nodes), len(row)))
        at = row[:, 0] * by.shape[2] + col[:, 0]
        self._ends = at, at + (by.shape[2] if axis else 1)

    def add(self, potential: Float, out: Single) -> None:
        """Add to weights (2, rows, cols) what a potential (rows, cols) makes."""
        flat, (one, other) = potential.ravel(), self._ends
        out.reshape(-1)[self._nodes] += self._values @ (flat[other] - flat[one])


class NodeVariance:
    """Variance of depth / h at single nodes of one reading, against the mean with an anchor's weights."""

    def __init__(self, linear: LinearIntegration, factor: Float, correlation: Float, anchor: Float) -> None:
        """factor, correlation: of `SlopeNoise`."""
        self._linear, self._correlation = linear, correlation.astype(np.float32)
        self._anchor = np.where(linear.island, anchor, 0.0)
        x, y, island = (np.ascontiguousarray(one) for one in (linear.x_mm, linear.y_mm, linear.island))
        x_turned, y_turned, turned = (np.ascontiguousarray(one.T) for one in (x, y, island))
        of_across = derivatives(x, y, island)
        of_down = derivatives(x_turned, y_turned, turned)
        ways = of_across, [one.T for one in of_down]
        self._by = tuple(
            np.ascontiguousarray(np.einsum("ijca,cij->aij", factor, np.stack(way)), np.float32)
            for way in ways
        )
        (_, down), (_, across) = stencils(linear.island)
        ends = (linear.across, across), (linear.down, down)
        self._next_to_gaps = [_NextToGaps(*one, axis, self._by[axis]) for axis, one in enumerate(ends)]
        steps = []
        for weights, next_to_gap in ends:
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
        rows, cols = weights.shape
        out, line, steps = (np.zeros(n, np.float32) for n in ((2, rows, cols), cols + 5, (rows + 5, cols)))
        _noise_weights(potential, self._across, self._down, self._taps, *self._by, line, steps, out)
        for one in self._next_to_gaps:
            one.add(potential, out)
        return variance_of_noise(out, self._correlation)
