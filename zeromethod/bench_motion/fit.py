"""Fit of rigid motion to a warp's displacement from rest, at some nodes, and of what motion cannot do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander2d

from zeromethod.arrays import Float, Mask
from zeromethod.bench_motion.modes import BenchModes
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.overlap import overlap_correlation, shared_nodes
from zeromethod.warp.warp import Warp

MOST_NODES = 400
"""Nodes that a fit looks at, evenly spread: as good as all, whose windows overlap."""

LEAST_NODES = 4
"""Nodes without which a motion, of at most six modes, is not determined."""
_LEAST_VALID = 0.7
"""Share of a fit's nodes that must be valid."""

_DOUBTFUL = 3.0
"""Times the median sigma that counts as noise: more is what light does to a node in every frame alike."""

_SIGMAS = 3.0
"""Standard deviations within which a node agrees with rigid motion."""
_DEGREE = 4
"""Of the polynomials in camera px that stand for what a press leaves of a fit."""

_DEPENDENT = 1e-3
"""Share of a polynomial that the terms before it must leave for it to count."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Displacement of a fit's nodes as a sum of orthonormal terms: the modes' first, then polynomials.

    values: (terms,) LCD px, rms over the nodes; mean over frames where several were added. noise_px: of each
    value. passing: share of the newest frame's nodes that agree with the modes within noise.
    """

    values: Float
    noise_px: float
    passing: float


class MotionFitter:
    """Fits modes to the displacement of some nodes, together with polynomials."""

    def __init__(self, modes: BenchModes, grid: NodeGrid, nodes: Mask) -> None:
        """Nodes: (rows, cols) of `grid`, `LEAST_NODES` or more; of many, an even lattice of `MOST_NODES`."""
        apart = max(1, int(np.ceil(np.sqrt(np.count_nonzero(nodes) / MOST_NODES))))
        chosen = np.zeros_like(nodes)
        chosen[::apart, ::apart] = nodes[::apart, ::apart]
        if np.count_nonzero(chosen) < LEAST_NODES:
            apart, chosen = 1, nodes
        self.nodes = np.flatnonzero(chosen)
        u, v = (one.ravel()[self.nodes] for one in grid.mesh())
        self._modes = modes.at(u, v)
        self.count = modes.count
        self._basis, self._to_modes = self._made(u, v)
        correlation = overlap_correlation(grid.period_px, grid.spacing_px)[::apart]
        self._shared = shared_nodes(correlation)

    @property
    def amplification(self) -> float:
        """Rms error of the motion over the whole view from an error of 1 at these nodes."""
        flat = self._modes.reshape(-1, self.count)
        values = np.linalg.eigvalsh(flat.T @ flat / len(self.nodes))
        return float(np.sqrt(np.mean(1.0 / np.maximum(values, 1e-12))))

    def _made(self, u: Float, v: Float) -> tuple[Float, Float]:
        """Terms (2 nodes, terms) whose squares' sum is the number of nodes; values to sum of modes."""
        nodes = len(u)
        x, y = (2.0 * (one - one.mean()) / max(float(np.ptp(one)), 1.0) for one in (u, v))
        powers = np.add.outer(np.arange(_DEGREE + 1), np.arange(_DEGREE + 1)).ravel()
        smooth = chebvander2d(x, y, [_DEGREE, _DEGREE])[:, powers <= _DEGREE]
        both = np.einsum("ab,nk->nabk", np.eye(2), smooth).reshape(nodes, 2, -1)
        flat = np.concatenate([self._modes, both], axis=-1).reshape(2 * nodes, -1)[
            :, : max(nodes, self.count)
        ]
        basis, triangle = np.linalg.qr(flat)
        size = np.abs(np.diag(triangle))
        kept = size > _DEPENDENT * size.max()
        kept[: self.count] = True
        first = triangle[: self.count, : self.count] / np.sqrt(nodes)
        return basis[:, kept] * np.sqrt(nodes), np.linalg.pinv(first, rcond=_DEPENDENT)

    def fit(self, warp: Warp, rest_q: Float) -> Terms | None:
        """Terms of `warp` less `rest_q` (rows, cols, 2) LCD px; None where too few nodes are valid."""
        valid = warp.flags.ravel()[self.nodes] == 0
        used = np.count_nonzero(valid)
        if used < max(_LEAST_VALID * len(self.nodes), LEAST_NODES):
            return None
        nodes, basis = self.nodes, self._basis
        if used < len(nodes):
            nodes, basis = nodes[valid], basis[np.repeat(valid, 2)]
        away = (warp.q.reshape(-1, 2)[nodes] - rest_q.reshape(-1, 2)[nodes]).ravel()
        sigma = warp.sigma.reshape(-1, 2)[nodes].ravel()
        values = basis.T @ away
        values = values / used if used == len(self.nodes) else np.linalg.pinv(basis.T @ basis) @ values
        left = np.abs(away - basis[:, : self.count] @ values[: self.count])
        allowed = UNLIKE * float(np.linalg.norm(values[: self.count]))
        passing = float(np.mean(left < _SIGMAS * sigma + allowed))
        noise2 = np.mean(np.minimum(sigma, _DOUBTFUL * np.median(sigma)) ** 2)
        noise_px = float(np.sqrt(noise2 * self._shared / used))
        return Terms(values, noise_px, passing)

    def motion(self, terms: Terms) -> Float:
        """Sum (modes,) of modes that the terms begin with."""
        result: Float = self._to_modes @ terms.values[: self.count]
        return result


UNLIKE = 0.04
"""Smooth displacement that motion cannot make, over that which it can, below which it is motion.

Of 300 presses (Gaussians of sigma 1.5 to 40 mm and tails like 1/r, in the view and outside it) the most alike
left 0.074; modes are linear, and of a camera turned by 3 px leave 0.01."""
