"""Passes that settle a depth: intersect, bisect, integrate, and again, until the surface no longer moves.

Each pass leaves 0.1 % (at rest) to 3 % (0.2 mm deep) of the error before it, so that a reading that starts
from the last one, moved on as it moved, takes two or three; one that starts at rest takes four or five.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.anchor import RestFit
from zeromethod.surface.anchoring import Anchoring, Anchors, Pass, largest
from zeromethod.surface.integrate import SlopeIntegrator, fill_in
from zeromethod.surface.rays import MirrorRays

_MAX_ITERATIONS = 14
_SETTLED_MM = 6e-8
"""Error of depth, by what the last pass left of the one before, below which it has settled."""
_SOLVED, _SOLVED_FROM_REST = 3e-3, 3e-4
"""Error of a pass's solution, relative: the next pass finds what it leaves, and counts it as unsettled. From
rest, passes are larger, and nodes are chosen by the second."""
_LEAST_LEFT = 0.03
"""Share of the error that a pass is taken to leave at least, as they leave more and less by turns."""


@dataclass(frozen=True, slots=True)
class Start:
    """Depth (rows, cols), mm, to start from, NaN where unknown; nodes at which it is about as deep as now."""

    depth: Float
    nodes: Mask


@dataclass(frozen=True, slots=True)
class Reading:
    """Depth (rows, cols) in mm, 0 off the island, with the slope and points of the last pass.

    steps: of depth that these slopes make, `SlopeIntegrator.steps`. fit: None where no node has a depth.
    """

    depth: Float
    slope: Float
    point: Float
    steps: tuple[Float, Float]
    fit: RestFit | None
    iterations: int


class Settling:
    """Settles depth on the lattice of one reader; its integrator keeps lattices and weights."""

    def __init__(self, rays: MirrorRays, integrator: SlopeIntegrator, anchors: Anchors) -> None:
        self._rays, self._integrator, self._anchors = rays, integrator, anchors

    def settle(self, q: Float, variance: Float, usable: Mask, start: Start | None) -> Reading:
        """Depth of the largest island of usable nodes (rows, cols).

        q: (rows, cols, 2) LCD px, NaN off the usable nodes. variance: (rows, cols, 2) rad^2 of slope. start:
        a depth shortly before; None for the mirror at rest.
        """
        integrator, scale = self._integrator, self._anchors.scale
        island = integrator.prepare(usable, variance)
        depth, weights = _begin(start, island)
        anchoring = Anchoring(self._anchors, weights)
        solved = _SOLVED_FROM_REST if weights is None else _SOLVED
        moved_mm = np.inf
        for iteration in range(1, _MAX_ITERATIONS + 1):
            slope, point = self._rays.slope(depth, q)
            readable = island & np.isfinite(slope[..., 0])
            if np.count_nonzero(readable) != np.count_nonzero(island):
                island = integrator.prepare(readable, variance)
            if not island.any():
                return Reading(np.zeros_like(depth), slope, point, (depth, depth), None, iteration)
            depth = np.where(island, depth, 0.0)
            steps = integrator.steps(slope, point[..., 0], point[..., 1])
            error = integrator.correction(steps, depth, solved)
            read = Pass(slope, variance, point, island, depth, error)
            step = np.where(island, scale * (error + anchoring.constant(read)), 0.0)
            if weights is not None and anchoring.doubtful:
                return self.settle(q, variance, usable, None)
            depth = depth + step
            before_mm, moved_mm = moved_mm, largest(step)
            left = min(max(moved_mm / before_mm, _LEAST_LEFT), 1.0) if iteration > 1 else 1.0
            if anchoring.fixed and moved_mm * left < _SETTLED_MM:
                break
        fit = anchoring.fit or self._anchors.nodes(read, 0.0)
        return Reading(depth, slope, point, steps, fit, iteration)


def _begin(start: Start | None, island: Mask) -> tuple[Float, Float | None]:
    """Depth to start from, and weights of the nodes whose mean it keeps until the anchor is chosen."""
    if start is not None:
        known = start.nodes & island & np.isfinite(start.depth)
        if known.any():
            depth = start.depth.copy()
            fill_in(depth)
            return depth, known / np.count_nonzero(known)
    return np.zeros(island.shape), None
