"""Integration of slope to depth: weighted least squares over all node-to-node differences.

The slope of a node depends on its depth (the ray meets a deeper mirror elsewhere, nearer to the LCD), so the
equations are  D_b - D_a = m_e(D)  with dm/dD = K dX. K is nearly the gradient of a function
kappa of the rest geometry; with `scale` h = exp(kappa) the update D + h e turns the linearised system into
a plain one for e,  e_b - e_a = (m_e - (D_b - D_a)) / h,  so each pass is a Gauss-Newton step at the cost
of a plain integration, and depth is known up to a multiple of h, not up to a constant.

Minimising sum w_e (D_b - D_a - m_e)^2 gives a graph Laplacian, A D = b. It is factorised once per mask
and set of weights (30 ms at 125x157 nodes on one core) and then solves in 1 ms. Conjugate gradients with
a DCT-based preconditioner take 1 ms per step and many steps once there is a hole, and old factors as
preconditioner need more steps than a factorisation costs when three nodes drop out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy import ndimage
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from zeromethod.arrays import Float, Mask
from zeromethod.surface.differences import depth_differences, depth_differences_adjoint

_KEEP_FACTOR = 2.0
"""Weights are kept while nodes' variances stay within this factor of those they were computed from:
any fixed weights give an unbiased depth, and an error of this size costs a few percent of noise."""
_KEEP_SHARE = 0.02
_RELAX, _PANEL = 4, 8
"""SuperLU's blocks: on a lattice the small ones take half the time of its own."""


def largest_island(valid: Mask) -> Mask:
    """Largest set of valid nodes connected along rows and columns (depth cannot cross a gap)."""
    labels, count = ndimage.label(valid)
    if count <= 1:
        return valid.copy()
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    island: Mask = labels == int(np.argmax(sizes))
    return island


@numba.njit(cache=True, error_model="numpy")
def share_changed(now: Float, kept: Float, nodes: Mask, factor: float) -> float:
    """Share of values that changed by more than a factor, up to one common to all, and either way.

    now, kept: (rows, cols, k), positive on the nodes (rows, cols); kept is 0 where unknown, and that does not
    count as changed unless it is most of them, which makes it 1.
    """
    rows, cols, depth = now.shape
    total_now, total_kept, known, count = 0.0, 0.0, 0, 0
    for i in range(rows):
        for j in range(cols):
            if nodes[i, j]:
                for k in range(depth):
                    count += 1
                    if kept[i, j, k] > 0.0:
                        known += 1
                        total_now += 1.0 / now[i, j, k]
                        total_kept += 1.0 / kept[i, j, k]
    if 2 * known < count or known == 0:
        return 1.0
    common = total_kept / total_now
    off = 0
    for i in range(rows):
        for j in range(cols):
            if nodes[i, j]:
                for k in range(depth):
                    if kept[i, j, k] > 0.0:
                        ratio = now[i, j, k] / kept[i, j, k]
                        off += ratio > factor * common or ratio * factor < common
    return off / known


@dataclass(frozen=True, slots=True)
class LatticeSolution:
    """Factors of A for one mask and set of weights."""

    factors: Any

    def solve(self, rhs: Float) -> Float:
        """D (..., rows, cols) for right-hand sides b (..., rows, cols); symmetric, as A is."""
        flat = rhs.reshape(-1, rhs.shape[-2] * rhs.shape[-1]).T
        solution: Float = self.factors.solve(np.asfortranarray(flat))
        return solution.T.reshape(rhs.shape)


class LatticeSolver:
    """Solver of A D = b on a lattice of (rows, cols) nodes for given edge weights."""

    def __init__(self, shape: tuple[int, int]) -> None:
        rows, cols = shape
        self._shape = shape
        count = rows * cols
        index = np.arange(count).reshape(shape)
        a = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
        b = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
        node = np.arange(count)
        row = np.concatenate([node, a, b])
        col = np.concatenate([node, b, a])
        self._matrix = csc_matrix((np.arange(1.0, len(row) + 1), (row, col)), shape=(count, count))
        self._order = np.rint(self._matrix.data).astype(np.intp) - 1
        self.solution = LatticeSolution(None)

    def set_weights(self, across: Float, down: Float, pin: tuple[int, int]) -> None:
        """Set edge weights (rows, cols-1) and (rows-1, cols), 0 = no edge; node `pin` is fixed at 0.

        The pin removes the free constant without damping. Nodes without edges are 0.
        """
        diagonal = np.zeros(self._shape)
        diagonal[:, :-1] += across
        diagonal[:, 1:] += across
        diagonal[:-1] += down
        diagonal[1:] += down
        diagonal[diagonal == 0.0] = 1.0
        diagonal[pin] *= 2.0
        edges = -np.concatenate([across.ravel(), down.ravel()])
        self._matrix.data = np.concatenate([diagonal.ravel(), edges, edges])[self._order]
        symmetric = {"SymmetricMode": True}
        self.solution = LatticeSolution(
            splu(
                self._matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                relax=_RELAX,
                panel_size=_PANEL,
                options=symmetric,
            )
        )


@dataclass(frozen=True, slots=True)
class LinearIntegration:
    """Linear part of one integration: from errors of slope to errors e of depth / h, and its transpose.

    Independent of later masks and weights of the integrator. island: (rows, cols) nodes.
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

        weights (..., rows, cols) must add up to 0, as e is known up to a constant; off the island they are
        ignored. This is the transpose of `depth`.
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
    """Sum at each node (rows, cols) of the steps that lead to it minus those that lead away."""
    out = np.zeros((across.shape[0], down.shape[1]))
    out[:, 1:] += across
    out[:, :-1] -= across
    out[1:] += down
    out[:-1] -= down
    return out


class SlopeIntegrator:
    """Integrator of slopes on a lattice of nodes; keeps its matrix factors between frames.

    The gain is 1 at every wavelength: nothing damps, weights only decide between contradictory slopes. Call
    `prepare` when mask or noise may have changed, then `integrate`.
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
        self._valid: Mask = np.zeros(shape, bool)
        self._across = np.zeros_like(self._h_across)
        self._down = np.zeros_like(self._h_down)
        self._pin = (0, 0)
        self.island: Mask = np.zeros(shape, bool)
        self.weightings = 0
        """Number of times the weights were computed."""

    def prepare(self, valid: Mask, variance: Float) -> Mask:
        """Set mask (rows, cols) and slope variance (rows, cols, 2); return the nodes that get a depth."""
        same = bool(np.array_equal(valid, self._valid))
        if not same:
            self._valid = valid.copy()
            island = largest_island(valid)
            same = bool(np.array_equal(island, self.island))
            self.island = island
        if not self.island.any():
            return self.island
        changed = share_changed(variance, self._variance, self.island, _KEEP_FACTOR) > _KEEP_SHARE
        if same and not changed:
            return self.island
        relative = np.where(self.island[..., None], variance, 0.0) / np.median(variance[self.island])
        if changed:
            self._variance = relative
            self.weightings += 1
        else:
            self._variance = np.where(self._variance > 0.0, self._variance, relative)
        self._set_weights()
        return self.island

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
        """Update e (rows, cols), up to a constant: depth_mm + h e has the given slope. 0 off the island.

        slope: (rows, cols, 2), (dd/dx, dd/dy) at the mirror points x_mm, y_mm (rows, cols), which are at
        depth_mm (rows, cols; default 0).
        """
        if not self.island.any():
            return np.zeros(self._shape)
        across, down = depth_differences(slope, x_mm, y_mm, self.island)
        if depth_mm is not None:
            across -= np.diff(depth_mm, axis=1)
            down -= np.diff(depth_mm, axis=0)
        return self._solver.solution.solve(_divergence(self._across * across, self._down * down))

    @property
    def step_weights(self) -> tuple[Float, Float]:
        """Weights (rows, cols-1), (rows-1, cols) of the steps' squared errors; 0 off the island."""
        return self._across / self._h_across, self._down / self._h_down

    def left_over(
        self, slope: Float, x_mm: Float, y_mm: Float, depth_mm: Float, linear: bool = False
    ) -> tuple[Float, Float]:
        """Steps (rows, cols-1), (rows-1, cols), mm, of the slopes that the depth does not make.

        linear: `depth_mm` is an error of depth / h, as `integrate` returns it, and `slope` one of slope.
        """
        across, down = depth_differences(slope, x_mm, y_mm, self.island)
        h_across, h_down = (self._h_across, self._h_down) if linear else (1.0, 1.0)
        both_across = self.island[:, :-1] & self.island[:, 1:]
        both_down = self.island[:-1] & self.island[1:]
        across = np.where(both_across, across - h_across * np.diff(depth_mm, axis=1), 0.0)
        return across, np.where(both_down, down - h_down * np.diff(depth_mm, axis=0), 0.0)

    def linear(self, x_mm: Float, y_mm: Float) -> LinearIntegration:
        """Integration with the present mask and weights over points at x_mm, y_mm (rows, cols)."""
        return LinearIntegration(self.island, x_mm, y_mm, self._across, self._down, self._solver.solution)
