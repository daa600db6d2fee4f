"""Passes that settle a depth: intersect, bisect, integrate, and again, until the surface no longer moves.

Rays are traced at one depth, with how slope and point change along them, and followed to first order from
there, until depth has moved so far that this is wrong. Each pass leaves 0.1 % (at rest) to 3 % (0.2 mm deep)
of the error before it. The shape settles with the constant that it started from; then the anchor is chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.anchor import RestFit
from zeromethod.surface.anchoring import AnchorFinder, Anchoring
from zeromethod.surface.integrate import SlopeIntegrator, fill_in
from zeromethod.surface.pass_result import PassResult
from zeromethod.surface.rays import MirrorRays

_MOST_PASSES = 40
_SETTLED_MM = 6e-8
"""Error of depth, by what the last pass left of the one before, below which it has settled."""
_NEARLY_MM = 5e-7
"""The same by which the anchor is chosen, whose constant it changes by a twentieth of it."""
_SOLVED = 1e-2
"""Error of a pass's solution, relative: the next pass finds what it leaves, and counts it as unsettled."""
_LEAST_LEFT, _MOST_LEFT = 0.02, 0.05
"""Share of the error that a pass is taken to leave, at least, and while it is not known."""


@dataclass(frozen=True, slots=True)
class Start:
    """Depth (rows, cols), mm, to start from, NaN where unknown; nodes at which it is about as deep as now.

    nodes: None where the anchor is chosen by this depth, at once.
    """

    depth: Float
    nodes: Mask | None


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

    def __init__(self, rays: MirrorRays, integrator: SlopeIntegrator, anchors: AnchorFinder) -> None:
        self._rays, self._integrator, self._anchors = rays, integrator, anchors

    def settle(
        self, q: Float, variance: Float, usable: Mask, start: Start | None, last: bool = True
    ) -> Reading:
        """Depth of the largest island of usable nodes (rows, cols).

        q: (rows, cols, 2) LCD px, NaN off the usable nodes. variance: (rows, cols, 2) rad^2 of slope. start:
        a depth shortly before; None for the mirror at rest. last: False where slopes are carried across seams
        by what is read, and are off until then: several dents would explain that, so one is fitted.
        """
        integrator, scale = self._integrator, self._anchors.scale
        island = integrator.prepare(usable, variance)
        depth, weights = _begin(start, island)
        anchoring = Anchoring(self._anchors, weights, last)
        anchoring.linear = integrator.linear
        looks, moved_mm, left_mm, curved_mm = 0, np.inf, 0.0, np.inf
        for _ in range(_MOST_PASSES):
            if curved_mm > max(left_mm, _SETTLED_MM):
                looks, moved_mm = looks + 1, np.inf
                look = self._rays.look(depth, q)
                slope, point = np.moveaxis(look.slope, 0, -1), np.moveaxis(look.point, 0, -1)
                readable = island & np.isfinite(slope[..., 0])
                if np.count_nonzero(readable) != np.count_nonzero(island):
                    island = integrator.prepare(readable, variance)
                if not island.any():
                    return Reading(np.zeros_like(depth), slope, point, (depth, depth), None, looks)
                depth = look.depth
                depth *= island
                read = PassResult(slope, variance, point, island, depth)
            steps = integrator.steps(slope, point[..., 0], point[..., 1])
            error = integrator.correction(steps, depth, _SOLVED)
            if np.isnan(error[0, 0]):  # all are where the equations were not solved: there is no depth then
                integrator.prepare(np.zeros_like(island), variance)
                return Reading(np.zeros_like(depth), slope, point, (depth, depth), None, looks)
            before_mm = moved_mm
            moved_mm, curved_mm = look.move(anchoring.shape(read, error))
            ratio = moved_mm / before_mm if before_mm < np.inf else _MOST_LEFT
            left_mm = moved_mm * min(max(ratio, _LEAST_LEFT), 1.0)
            if max(left_mm, curved_mm) > (_SETTLED_MM if anchoring.fixed else _NEARLY_MM):
                continue
            if not anchoring.fixed:
                by_mm = anchoring.choose(read)
                if weights is not None and anchoring.doubtful:
                    if not anchoring.chooses_so_after(self._first_pass(q, variance, island), read):
                        return self.settle(q, variance, usable, None, last)
                    weights = None
                _, curved_mm = look.move(by_mm * scale * island)
                moved_mm, left_mm = np.inf, left_mm + _MOST_LEFT * abs(by_mm)
            if anchoring.fixed and max(left_mm, curved_mm) < _SETTLED_MM:
                break
        fit = anchoring.fit or self._anchors.nodes(read, 0.0)[0]
        return Reading(depth, slope, point, steps, fit, looks)

    def _first_pass(self, q: Float, variance: Float, island: Mask) -> PassResult | None:
        """The first pass of a reading from rest; None where it does not read all of the island."""
        rest = np.zeros(island.shape)
        look = self._rays.look(rest, q)
        slope, point = np.moveaxis(look.slope, 0, -1), np.moveaxis(look.point, 0, -1)
        if not np.isfinite(slope[island]).all():
            return None
        steps = self._integrator.steps(slope, point[..., 0], point[..., 1])
        depth = self._anchors.scale * self._integrator.correction(steps, rest, _SOLVED)
        return PassResult(slope, variance, point, island, depth)


def _begin(start: Start | None, island: Mask) -> tuple[Float, Float | None]:
    """Depth to start from, and weights of the nodes whose mean it keeps until the anchor is chosen."""
    if start is not None:
        known = island & np.isfinite(start.depth)
        known = known if start.nodes is None else known & start.nodes
        if known.any():
            depth = start.depth.copy()
            fill_in(depth)
            return depth, None if start.nodes is None else known / np.count_nonzero(known)
    return np.zeros(island.shape), None
