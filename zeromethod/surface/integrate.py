"""From slope to depth: weighted least squares over all node-to-node differences.

The slope that a reading means depends on depth (the ray meets a deeper mirror elsewhere, nearer to the
LCD), so the equations are  D_b - D_a = m_e(D)  with dm/dD = K dX. K is nearly the gradient of a function
kappa of the rest geometry; with `scale` h = exp(kappa) the update D + h e turns the linearised system into
a plain one for e,  e_b - e_a = (m_e - (D_b - D_a)) / h,  so each pass is a Gauss-Newton step at the price
of a plain integration, and depth is known up to a multiple of h, not up to a constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from zeromethod.arrays import Float, Mask
from zeromethod.surface.differences import depth_differences, depth_differences_adjoint
from zeromethod.surface.poisson import LatticeSolution, LatticeSolver

_KEEP_FACTOR = 2.0
"""Weights are kept while nodes' variances stay within this factor of the ones they were made from:
any fixed weights give an unbiased depth, and being off by this much costs a few percent of noise."""
_KEEP_SHARE = 0.02


def largest_island(valid: Mask) -> Mask:
    """Keep the largest set of valid nodes connected along rows and columns (depth cannot cross a gap)."""
    labels, count = ndimage.label(valid)
    if count <= 1:
        return valid.copy()
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    island: Mask = labels == int(np.argmax(sizes))
    return island


@dataclass(frozen=True, slots=True)
class LinearIntegration:
    """An integration's linear part, as it stood: from errors of slope to errors e of depth / h, and back.

    Stays what it is when the integrator goes on to other masks and weights. island: (rows, cols) nodes.
    """

    island: Mask
    x_mm: Float
    y_mm: Float
    across: Float
    down: Float
    solution: LatticeSolution

    def depth(self, slope: Float) -> Float:
        """E (rows, cols) in mm, up to a constant, of slope errors (rows, cols, 2), rad."""
        across, down = depth_differences(slope, self.x_mm, self.y_mm, self.island)
        return self.solution.solve(_divergence(self.across * across, self.down * down))

    def slope_weights(self, weights: Float) -> Float:
        """Weights (..., rows, cols, 2), mm, with which the slopes enter sum(weights * e).

        weights (..., rows, cols) must add up to 0, as e is known up to a constant; off the island they do
        not count. This is the transpose of `depth`.
        """
        potential = self.solution.solve(np.where(self.island, weights, 0.0))
        flat = potential.reshape(-1, *self.island.shape)
        out = np.stack(
            [
                depth_differences_adjoint(
                    self.across * np.diff(one, axis=1),
                    self.down * np.diff(one, axis=0),
                    self.x_mm,
                    self.y_mm,
                    self.island,
                )
                for one in flat
            ]
        )
        return out.reshape(*potential.shape, 2)


def _divergence(across: Float, down: Float) -> Float:
    """Sum at each node (rows, cols) of the steps that lead to it less those that lead away."""
    out = np.zeros((across.shape[0], down.shape[1]))
    out[:, 1:] += across
    out[:, :-1] -= across
    out[1:] += down
    out[:-1] -= down
    return out


class SlopeIntegrator:
    """Integrates slopes on a lattice of nodes; keeps its matrix factors between frames.

    The gain is 1 at every wavelength: nothing damps, weights only decide between readings that
    contradict each other. Call `prepare` when mask or noise may have changed, then `integrate`.
    """

    def __init__(self, x_mm: Float, y_mm: Float, scale: Float | None = None) -> None:
        """x_mm, y_mm: (rows, cols) mirror points at rest, for the edges' lengths; scale: h (rows, cols)."""
        shape = x_mm.shape
        self._shape = shape
        self._solver = LatticeSolver((shape[0], shape[1]))
        h = np.ones(shape) if scale is None else scale
        self._h_across = np.sqrt(h[:, :-1] * h[:, 1:])
        self._h_down = np.sqrt(h[:-1] * h[1:])
        self._step_across = np.stack([np.diff(x_mm, axis=1), np.diff(y_mm, axis=1)], axis=-1)
        self._step_down = np.stack([np.diff(x_mm, axis=0), np.diff(y_mm, axis=0)], axis=-1)
        self._variance = np.zeros((*shape, 2))
        self._across = np.zeros_like(self._h_across)
        self._down = np.zeros_like(self._h_down)
        self._pin = (0, 0)
        self.island: Mask = np.zeros(shape, bool)
        self.weightings = 0
        """How often the weights were made anew."""

    def prepare(self, valid: Mask, variance: Float) -> Mask:
        """Set mask (rows, cols) and slope variance (rows, cols, 2); return the nodes that get a depth."""
        island = largest_island(valid)
        same = bool(np.array_equal(island, self.island))
        self.island = island
        if not island.any():
            return island
        relative = np.where(island[..., None], variance, 0.0) / np.median(variance[island])
        if self._weights_changed(relative):
            self._variance = relative
            self.weightings += 1
        elif same:
            return island
        else:
            self._variance = np.where(self._variance > 0.0, self._variance, relative)
        self._set_weights()
        return island

    def _weights_changed(self, relative: Float) -> bool:
        known = self.island & (self._variance > 0.0).all(axis=-1)
        if 2 * np.count_nonzero(known) < np.count_nonzero(self.island):
            return True
        ratio = relative[known] / self._variance[known]
        ratio = ratio / np.median(ratio)
        off = (ratio > _KEEP_FACTOR) | (ratio < 1.0 / _KEEP_FACTOR)
        return bool(np.mean(off) > _KEEP_SHARE)

    def _set_weights(self) -> None:
        island, variance = self.island, self._variance
        spread = (0.5 * (variance[:, :-1] + variance[:, 1:]) * self._step_across**2).sum(axis=-1)
        both = island[:, :-1] & island[:, 1:]
        self._across = self._h_across / np.where(both, spread, np.inf)
        spread = (0.5 * (variance[:-1] + variance[1:]) * self._step_down**2).sum(axis=-1)
        both = island[:-1] & island[1:]
        self._down = self._h_down / np.where(both, spread, np.inf)
        if not island[self._pin]:
            nodes = np.argwhere(island)
            row, col = nodes[len(nodes) // 2]
            self._pin = (int(row), int(col))
        self._solver.set_weights(self._across * self._h_across, self._down * self._h_down, self._pin)

    def integrate(self, slope: Float, x_mm: Float, y_mm: Float, depth_mm: Float | None = None) -> Float:
        """Update e (..., rows, cols), up to a constant: depth_mm + h e has the given slope. 0 off the island.

        slope: (..., rows, cols, 2), (dd/dx, dd/dy) at the mirror points x_mm, y_mm (rows, cols), read with
        the points at depth_mm (rows, cols; default 0).
        """
        if not self.island.any():
            return np.zeros(slope.shape[:-1])
        lattices = slope.reshape(-1, *slope.shape[-3:])
        rhs = np.stack([self._right_hand_side(one, x_mm, y_mm, depth_mm) for one in lattices])
        return self._solver.solve(rhs).reshape(slope.shape[:-1])

    def _right_hand_side(self, slope: Float, x_mm: Float, y_mm: Float, depth_mm: Float | None) -> Float:
        across, down = depth_differences(slope, x_mm, y_mm, self.island)
        if depth_mm is not None:
            across -= np.diff(depth_mm, axis=1)
            down -= np.diff(depth_mm, axis=0)
        return _divergence(self._across * across, self._down * down)

    def linear(self, x_mm: Float, y_mm: Float) -> LinearIntegration:
        """Integration with the present mask and weights over points at x_mm, y_mm (rows, cols)."""
        return LinearIntegration(self.island, x_mm, y_mm, self._across, self._down, self._solver.solution)
