"""Samples of depth's variance: exact at some nodes of one reading, and the map through them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.surface.integrate import LinearIntegration
from zeromethod.surface.node_variance import NodeVariance
from zeromethod.surface.rough_variance import log_rough_variance
from zeromethod.surface.thin_plate import thin_plate
from zeromethod.warp.continuation import continue_smoothly

_SAMPLES_PER_AXIS = 13
"""Samples along each axis, closer to each other towards the border."""
_EVERY = 4, 2, 1
"""Of them, those of each stage along both axes, with those of the stages before."""
_AROUND = np.array([-6, -3, -1, 0, 1, 3, 6])
"""Further samples around the narrowest dent, nodes from it along both axes."""
_SOME_AROUND = 5
"""Of these, every so many is of the second stage."""
_BLURS, _OFF_BORDER = ((3, 3), (15, 15)), 3
"""Windows, in nodes, whose ratio of noise shows a narrow dent, and how far from holes one is looked for."""
_RINGS, _ON_RING = 2, 16
"""Rings around holes, and samples on each."""
AT_FIRST, A_FEW, SELDOM = 16, 2, 3
"""Samples by which there is a map; those worked out in one reading where a few will do, while the first stage
lasts; and readings to each sample then."""
_CAREFUL = 1.4
"""Variance by another mask's samples over what it most likely is: the rough one is off by up to 15 %."""
_CHANGED = 0.1
"""Share of nodes that came or went from which that holds; masks that flicker by a few are off alike."""
_GOLDEN = 0.618
"""Multiples of it, less whole numbers, are spread evenly, however many there are."""
_LEAST_SAMPLE = 1e-6
"""Variance of a sample over the largest, at least."""


class Samples:
    """Exact variances at some nodes of one reading, those at which to begin first, and the map through them.

    Nodes next to a hole are apart: their noise is much their own, and says nothing of those around. Of each
    ring around holes a few say by how much the map is off there. Until there are samples, the rough variance
    is off as much as it was for another mask, and next to holes not at all, where it is too large.
    """

    def __init__(
        self,
        linear: LinearIntegration,
        make_factor: Callable[[], Float],
        correlation: Float,
        power: Float,
        anchor: Float,
        grown: Float | float = 1.0,
        off: Float | None = None,
        other: Mask | None = None,
    ) -> None:
        """make_factor: of that, and correlation, of `SlopeNoise`; power: (rows, cols) sum of its variances.

        anchor: weights (rows, cols) of the mean that is taken as 0. grown: depth's variance over that by the
        noise that the integration's weights are for, about. off: `Samples.off` of another mask, `other`.
        """
        self._reading = linear, make_factor, correlation, anchor
        self._power = power
        self._island = island = linear.island
        rough = log_rough_variance(linear.solution, np.where(island, anchor, 0.0)) + np.log(grown)
        # nodes of holes may come back while the samples are kept
        self._rough = continue_smoothly(np.stack([rough, rough], axis=-1), island)[..., 0]
        self.off = self._before = off
        """Logarithm (rows, cols) of the variance over the rough one, as it varies slowly; None: not known."""
        changed = 1.0 if other is None else np.count_nonzero(other != island) / np.count_nonzero(island)
        self._careful = 1 + (_CAREFUL - 1) * min(changed / _CHANGED, 1.0)
        self.taken = 0

    @cached_property
    def _exact(self) -> NodeVariance:
        linear, make_factor, correlation, anchor = self._reading
        return NodeVariance(linear, make_factor(), correlation, anchor)

    @cached_property
    def _rings(self) -> list[Mask]:
        return _rings(self._island)

    @cached_property
    def _parts(self) -> list[Ints]:
        """Nodes to be sampled: all over the island, and on each ring."""
        inside = self._island & ~np.any(self._rings, axis=0)
        inside = inside if inside.any() else self._island
        first, *others = sample_nodes(inside, _at_narrowest(self._power, inside))
        # the first few are to be all over the island, too
        spread = np.argsort(_GOLDEN * np.arange(len(first)) % 1.0)
        # in no even steps, as a row may cross a ring twice
        return [
            first[spread],
            *others,
            *(
                on[np.unique(np.linspace(0, len(on) - 1, min(_ON_RING, len(on))).astype(np.intp))]
                for on in map(np.flatnonzero, self._rings)
            ),
        ]

    @cached_property
    def nodes(self) -> Ints:
        """Flat numbers of all that are sampled, in turn."""
        return np.concatenate(self._parts)

    @cached_property
    def _ends(self) -> NDArray[np.intp]:
        return np.cumsum([len(one) for one in self._parts])

    @property
    def stage(self) -> int:
        """How many of the stages are complete; the last one with the rings."""
        return (
            0
            if self.taken == 0
            else sum(self.taken >= end for end in (*self._ends[: len(_EVERY) - 1], self._ends[-1]))
        )

    @cached_property
    def _found(self) -> Float:
        return np.zeros(len(self.nodes))

    @property
    def complete(self) -> bool:
        """Whether no sample is left to be taken."""
        return self.taken > 0 and self.taken == len(self.nodes)

    def take(self, most: int | None) -> None:
        """Work out at most so many more; None: all."""
        end = len(self.nodes) if most is None else min(self.taken + most, len(self.nodes))
        self._found[self.taken : end] = self._exact.of(self.nodes[self.taken : end])
        self.taken = end

    def variance(self) -> Float:
        """Map (rows, cols) of depth / h, mm^2, by the samples so far, or by what is known of another mask."""
        if self.taken == 0:
            assert self.off is not None
            return np.asarray(self._careful * np.exp(self._rough + self.off))
        found = self._found[: self.taken]
        if self.stage == 0 and self._before is not None:
            # so few say how much all of it is off; that which was known before counts as one of them
            likely, at = self._rough + self._before, self.nodes[: self.taken]
            over = np.log(np.maximum(found, 1e-30)) - likely.ravel()[at]
            more = (math.log(self._careful) + float(over.sum())) / (1 + self.taken)
            return np.asarray(np.exp(likely + more))
        # nodes whose own depth is the anchor have none
        over = np.log(np.maximum(found, _LEAST_SAMPLE * found.max(initial=1e-30)))
        over -= self._rough.ravel()[self.nodes[: self.taken]]
        ends = self._ends[len(_EVERY) - 1 :]
        first = min(self.taken, ends[0])
        at = self.nodes[:first]
        # few say best by how much that has changed which was known before
        before = np.zeros(self._rough.shape) if self._before is None or first == ends[0] else self._before
        self.off = before + thin_plate(at, over[:first] - before.ravel()[at], *before.shape)
        out = self._rough + self.off
        for ring, start, end in zip(self._rings, ends[:-1], ends[1:], strict=True):
            if start < end <= self.taken:
                at = self.nodes[start:end]
                off = over[start:end] + self._rough.ravel()[at] - out.ravel()[at]
                out[ring] += _nearby(
                    np.argwhere(ring), np.stack(np.unravel_index(at, ring.shape), axis=-1), off
                )
        return np.asarray(np.exp(out))


def _nearby(places: Ints, known: Ints, values: Float) -> Float:
    """Means (n,) of values (m,), of known places (m, 2), by the inverse squared distance of places (n, 2)."""
    weights = 1.0 / (np.square(places[:, None] - known[None]).sum(axis=-1) + 1.0)
    return np.asarray((weights * values).sum(axis=1) / weights.sum(axis=1))


def _rings(island: Mask) -> list[Mask]:
    """Nodes next to a hole of the island, those next to them, and so on, each (rows, cols)."""
    rings, before = [], ~island
    for _ in range(_RINGS):
        wider = ndimage.binary_dilation(before, np.ones((3, 3), bool))
        rings.append(wider & ~before)
        before = wider
    return rings


def _at_narrowest(power: Float, island: Mask) -> NDArray[np.intp]:
    """Flat numbers of nodes where noise is most above that around: a narrow dent's bends do that."""
    known = island.astype(np.float64)
    near, wide = (
        cv2.blur(np.where(island, power, 0.0), size) / np.maximum(cv2.blur(known, size), 1e-9)
        for size in _BLURS
    )
    inside = ndimage.binary_erosion(island, iterations=_OFF_BORDER)
    excess = np.where(inside, near / np.maximum(wide, 1e-300), 0.0)
    row, col = np.unravel_index(int(np.argmax(excess)), island.shape)
    rows, cols = (
        (at + _AROUND)[(at + _AROUND >= 0) & (at + _AROUND < n)]
        for at, n in zip((row, col), island.shape, strict=True)
    )
    chosen = np.zeros(island.shape, bool)
    chosen[np.ix_(rows, cols)] = True
    return np.flatnonzero(chosen & island)


def sample_nodes(island: Mask, narrow: NDArray[np.intp]) -> list[Ints]:
    """Flat numbers of the `narrow` ones and of island nodes on Chebyshev's points of both axes, in stages.

    First those of every fourth along both axes; with others, evenly, where hardly any are on the island.
    Then those of every second, and some of the narrow ones; then all.
    """
    stage = np.full(island.shape, len(_EVERY))
    along = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _SAMPLES_PER_AXIS)))
    places = []
    for axis in (1, 0):
        there = np.flatnonzero(island.any(axis=axis))
        places.append(np.rint(there[0] + (there[-1] - there[0]) * along).astype(np.intp))
    stage.ravel()[narrow] = 2
    stage[np.ix_(*places)] = 2
    stage.ravel()[narrow[::_SOME_AROUND]] = 1
    for number in (1, 0):
        stage[np.ix_(*(one[:: _EVERY[number]] for one in places))] = number
    if np.count_nonzero(island & (stage == 0)) < AT_FIRST // 2:
        on = np.flatnonzero(island)
        stage.ravel()[on[:: max(len(on) // AT_FIRST, 1)]] = 0
    return [np.flatnonzero((stage == number) & island).astype(np.int64) for number in range(len(_EVERY))]
