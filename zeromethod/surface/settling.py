"""Passes that settle a depth: intersect, bisect, integrate, and again, until the surface no longer moves.

Rays are traced at one depth, with how slope and point change along them, and followed to first order from
there, until depth has moved so far that this is wrong. Each pass leaves 0.1 % (at rest) to 3 % (0.2 mm deep)
of the error before it. The shape settles with the constant that it started from; then the anchor is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import KnownRest
from zeromethod.surface.anchor import RestFit
from zeromethod.surface.anchoring import Anchoring
from zeromethod.surface.integrate import SlopeIntegrator, fill_in
from zeromethod.surface.kept_constant import KeptConstant
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

    def __init__(
        self,
        rays: MirrorRays,
        integrator: SlopeIntegrator,
        scale: Float,
        known_rest: Sequence[KnownRest],
        constant: KeptConstant,
    ) -> None:
        """scale: h (rows, cols). known_rest: where the mirror is declared to be at rest."""
        self._rays, self._integrator, self._scale = rays, integrator, scale
        self._anchored_by = known_rest, constant

    def settle(
        self, q: Float, variance: Float, usable: Mask, start: Float | None, last: bool = True
    ) -> Reading:
        """Depth of the largest island of usable nodes (rows, cols).

        q: (rows, cols, 2) LCD px, NaN off the usable nodes. variance: (rows, cols, 2) rad^2 of slope. start:
        a depth (rows, cols) shortly before, mm, NaN where unknown; None for the mirror at rest. last: False
        where slopes are carried across seams by what is read, and are off until then.
        """
        integrator, scale = self._integrator, self._scale
        island = integrator.prepare(usable, variance)
        depth = np.zeros(island.shape)
        if start is not None and np.isfinite(start[island]).any():
            depth[:] = start
            fill_in(depth)
        anchoring = Anchoring(*self._anchored_by, integrator, scale, last)
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
                _, curved_mm = look.move(by_mm * scale * island)
                moved_mm, left_mm = np.inf, left_mm + _MOST_LEFT * abs(by_mm)
            if anchoring.fixed and max(left_mm, curved_mm) < _SETTLED_MM:
                break
        if anchoring.fit is None:
            anchoring.choose(read)
        return Reading(depth, slope, point, steps, anchoring.fit, looks)
