"""Integration of slope to depth: weighted least squares over all node-to-node differences.

The slope of a node depends on its depth (the ray meets a deeper mirror elsewhere, nearer to the LCD), so the
equations are  D_b - D_a = m_e(D)  with dm/dD = K dX. K is nearly the gradient of a function
kappa of the rest geometry; with `scale` h = exp(kappa) the update D + h e turns the linearised system into
a plain one for e,  e_b - e_a = (m_e - (D_b - D_a)) / h,  so each pass is a Gauss-Newton step at the cost
of a plain integration, and depth is known up to a multiple of h, not up to a constant.

Minimising sum w_e (D_b - D_a - m_e)^2 gives a graph Laplacian, A D = b, which `multigrid` solves: 0.15 ms for
each digit at 125x157 nodes on one core, and 1.5 ms once per mask and set of weights. (Sparse factors take
35 ms, and then 1 ms a solution.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy import ndimage

from zeromethod.arrays import Float, Mask
from zeromethod.kernels import kernel, read
from zeromethod.rounding import REORDERED
from zeromethod.surface.differences import depth_differences, depth_differences_adjoint, stencils
from zeromethod.surface.multigrid import EXACT, LatticeSolution

_KEEP_FACTOR = 2.0
"""Weights are kept while nodes' variances stay within this factor of those they were computed from:
any fixed weights give an unbiased depth, and an error of this size costs a few percent of noise."""
_KEEP_SHARE = 0.02


def largest_island(valid: Mask) -> Mask:
    """Largest set of valid nodes connected along rows and columns (depth cannot cross a gap)."""
    labels, count = ndimage.label(valid)
    if count <= 1:
        return valid.copy()
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    island: Mask = labels == int(np.argmax(sizes))
    return island


@kernel(numba.float64[:, ::1])
def fill_in(values: Float) -> None:
    """Replace NaN by the value of the next node that has one, as the rows come and back again; else 0."""
    rows, cols = values.shape
    for step in (1, -1):
        for k in range(rows):
            i = k if step == 1 else rows - 1 - k
            for m in range(cols):
                j = m if step == 1 else cols - 1 - m
                if np.isnan(values[i, j]):
                    if 0 <= j - step < cols and not np.isnan(values[i, j - step]):
                        values[i, j] = values[i, j - step]
                    elif 0 <= i - step < rows and not np.isnan(values[i - step, j]):
                        values[i, j] = values[i - step, j]
    for i in range(rows):
        for j in range(cols):
            if np.isnan(values[i, j]):
                values[i, j] = 0.0


@kernel(
    read(numba.float64, 1), read(numba.float64, 1), read(numba.boolean, 1), numba.float64,
    fastmath=REORDERED,
)  # fmt: skip
def share_changed(now: Float, kept: Float, nodes: Mask, factor: float) -> float:
    """Share of values that changed by more than a factor, up to one common to all, and either way.

    now, kept: (n,), positive where `nodes` (n,) is true; kept is 0 where unknown, and that does not count as
    changed unless it is most of them, which makes it 1.
    """
    total_now, total_kept, known, count = 0.0, 0.0, 0, 0
    for k in range(len(now)):
        there = nodes[k] & (kept[k] > 0.0)
        count += nodes[k]
        known += there
        total_now += 1.0 / now[k] if there else 0.0
        total_kept += 1.0 / kept[k] if there else 0.0
    if 2 * known < count or known == 0:
        return 1.0
    common = total_kept / total_now
    off = 0
    for k in range(len(now)):
        one, other = now[k], common * kept[k]
        off += nodes[k] & (other > 0.0) & ((one > factor * other) | (one * factor < other))
    return off / known


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

    def depth(self, slope: Float, share: float = EXACT) -> Float:
        """E (rows, cols) in mm, up to a constant, of slope errors (rows, cols, 2), rad; share: as below."""
        across, down = depth_differences(slope, self.x_mm, self.y_mm, self.island)
        return self.solution.solve(_divergence(self.across * across, self.down * down), share)

    def slope_weights(self, weights: Float, share: float = EXACT) -> Float:
        """Weights (..., rows, cols, 2), mm, with which the slopes enter sum(weights * e).

        weights (..., rows, cols) must add up to 0, as e is known up to a constant; off the island they are
        ignored. This is the transpose of `depth`. share: error that is allowed for, relative.
        """
        potential = self.solution.solve(np.where(self.island, weights, 0.0), share)
        across, down = self.across * np.diff(potential, axis=-1), self.down * np.diff(potential, axis=-2)
        return depth_differences_adjoint(across, down, self.x_mm, self.y_mm, self.island)


@kernel(
    read(numba.float64, 2), read(numba.float64, 2), read(numba.float64, 2), read(numba.float64, 2),
    read(numba.float64, 2), numba.float64[:, ::1],
)  # fmt: skip
def _lacking(across: Float, down: Float, depth: Float, of_across: Float, of_down: Float, out: Float) -> None:
    """Weighted steps that lead to each node (rows, cols) minus those that lead away, less those of depth."""
    rows, cols = depth.shape
    for i in range(rows):
        for j in range(cols):
            out[i, j] = 0.0
        for j in range(cols - 1):
            out[i, j] -= of_across[i, j] * (across[i, j] - depth[i, j + 1] + depth[i, j])
        for j in range(1, cols):
            out[i, j] += of_across[i, j - 1] * (across[i, j - 1] - depth[i, j] + depth[i, j - 1])
    for i in range(rows - 1):
        for j in range(cols):
            step = of_down[i, j] * (down[i, j] - depth[i + 1, j] + depth[i, j])
            out[i + 1, j] += step
            out[i, j] -= step


def _edge_weights(variance: Float, step: Float, h: Float, island: Mask, axis: int) -> Float:
    """Weights of the edges to the next row (axis 0) or column (1), 0 off the island; step: (..., 2) mm."""
    one, other = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
    mean = 0.5 * (variance[one] + variance[other])
    spread = mean[..., 0] * step[..., 0] ** 2 + mean[..., 1] * step[..., 1] ** 2
    return np.divide(h, spread, out=np.zeros(h.shape), where=island[one] & island[other])


def _divergence(across: Float, down: Float) -> Float:
    """Sum at each node (rows, cols) of the steps that lead to it minus those that lead away."""
    out = np.zeros((across.shape[0], down.shape[1]))
    out[:, 1:] += across
    out[:, :-1] -= across
    out[1:] += down
    out[:-1] -= down
    return out


@dataclass(frozen=True, slots=True)
class _Edges:
    """Weights of the edges of one island (rows, cols), of one weighting, and the solution with them."""

    island: Mask
    weighting: int
    across: Float
    down: Float
    solution: LatticeSolution | None


class SlopeIntegrator:
    """Integrator of slopes on a lattice of nodes; keeps its lattices between frames.

    The gain is 1 at every wavelength: nothing damps, weights only decide between contradictory slopes. Call
    `prepare` when mask or noise may have changed, then `integrate`.
    """

    def __init__(self, x_mm: Float, y_mm: Float, scale: Float | None = None) -> None:
        """x_mm, y_mm: (rows, cols) mirror points at rest, for the edges' lengths; scale: h (rows, cols)."""
        shape = x_mm.shape
        self._shape = shape
        h = np.ones(shape) if scale is None else scale
        self._h_across = np.sqrt(h[:, :-1] * h[:, 1:])
        self._h_down = np.sqrt(h[:-1] * h[1:])
        self._step_across = np.stack([np.diff(x_mm, axis=1), np.diff(y_mm, axis=1)], axis=-1)
        self._step_down = np.stack([np.diff(x_mm, axis=0), np.diff(y_mm, axis=0)], axis=-1)
        self._variance = self._variance_before = np.zeros((*shape, 2))
        self._weighting_before = self._count = 0
        self._valid: Mask = np.zeros(shape, bool)
        self._edges = _Edges(self._valid, 0, np.zeros_like(self._h_across), np.zeros_like(self._h_down), None)
        self._earlier = self._edges
        self.island: Mask = np.zeros(shape, bool)
        self._near_gaps = self.island, stencils(self.island)
        self.weighting = 0
        """Number of the weights in use; those before them may come back."""

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
        changed = self._changed(variance, self._variance)
        if same and not changed:
            return self.island
        if changed:
            before = self._variance_before, self._weighting_before
            self._variance_before, self._weighting_before = self._variance, self.weighting
            # a dent that has come to rest leaves the noise as it was
            self._variance, self.weighting = before
            changed = self._changed(variance, self._variance)
        # on the island alone: variance may be 0 elsewhere
        typical = 1.0 / float(np.mean(1.0 / variance[self.island]))
        relative = np.where(self.island[..., None], variance, 0.0) / typical
        if changed:
            self._count += 1
            self._variance, self.weighting = relative, self._count
        else:
            self._variance = np.where(self._variance > 0.0, self._variance, relative)
        self._set_weights()
        return self.island

    def _changed(self, variance: Float, kept: Float) -> bool:
        values = variance.ravel(), kept.ravel(), np.repeat(self.island.ravel(), 2)
        return bool(share_changed(*values, _KEEP_FACTOR) > _KEEP_SHARE)

    def _set_weights(self) -> None:
        island, variance = self.island, self._variance
        self._edges, self._earlier = self._earlier, self._edges
        # nodes that a dent hides for a frame come back
        if self._edges.weighting == self.weighting and np.array_equal(self._edges.island, island):
            return
        across = _edge_weights(variance, self._step_across, self._h_across, island, 1)
        down = _edge_weights(variance, self._step_down, self._h_down, island, 0)
        solution = LatticeSolution.of(across * self._h_across, down * self._h_down)
        self._edges = _Edges(island, self.weighting, across, down, solution)

    def integrate(
        self, slope: Float, x_mm: Float, y_mm: Float, depth_mm: Float | None = None, share: float = EXACT
    ) -> Float:
        """Update e (rows, cols), up to a constant: depth_mm + h e has the given slope. 0 off the island.

        slope: (rows, cols, 2), (dd/dx, dd/dy) at the mirror points x_mm, y_mm (rows, cols), which are at
        depth_mm (rows, cols; default 0). share: error of e that is allowed for, relative.
        """
        return self.correction(self.steps(slope, x_mm, y_mm), depth_mm, share)

    def steps(self, slope: Float, x_mm: Float, y_mm: Float) -> tuple[Float, Float]:
        """Steps of depth (rows, cols-1), (rows-1, cols), mm, that slopes make; arguments as `integrate`."""
        if self._near_gaps[0] is not self.island:
            self._near_gaps = self.island, stencils(self.island)
        return depth_differences(slope, x_mm, y_mm, *self._near_gaps)

    def correction(
        self, steps: tuple[Float, Float], depth_mm: Float | None = None, share: float = EXACT
    ) -> Float:
        """As `integrate`, of the slopes' `steps`."""
        edges = self._edges
        if edges.solution is None or not self.island.any():
            return np.zeros(self._shape)
        rhs = np.empty(self._shape)
        depth_mm = np.zeros(self._shape) if depth_mm is None else depth_mm
        _lacking(*steps, depth_mm, edges.across, edges.down, rhs)
        return edges.solution.solve(rhs, share)

    @property
    def variance(self) -> Float:
        """Slope variance (rows, cols, 2) that the weights are for, up to a factor; 0 where never known."""
        return self._variance

    @property
    def step_weights(self) -> tuple[Float, Float]:
        """Weights (rows, cols-1), (rows-1, cols) of the steps' squared errors; 0 off the island."""
        return self._edges.across / self._h_across, self._edges.down / self._h_down

    def left_over(self, steps: tuple[Float, Float], error_mm: Float) -> tuple[Float, Float]:
        """Of the `steps` by errors of slope, those (rows, cols-1), (rows-1, cols), mm, that no depth makes.

        error_mm: (rows, cols) of depth / h, as `integrate` returns it.
        """
        across = (self._edges.across > 0.0) * (steps[0] - self._h_across * np.diff(error_mm, axis=1))
        return across, (self._edges.down > 0.0) * (steps[1] - self._h_down * np.diff(error_mm, axis=0))

    def linear(self, x_mm: Float, y_mm: Float) -> LinearIntegration:
        """Integration with the present mask and weights over points at x_mm, y_mm (rows, cols)."""
        edges = self._edges
        assert edges.solution is not None
        return LinearIntegration(self.island, x_mm, y_mm, edges.across, edges.down, edges.solution)
