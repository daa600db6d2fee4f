"""Anchor: the constant that slopes leave open, fixed where the rubber is known or found to be at rest.

Depth is fixed up to C h, with h the integrator's scale (see `integrate`); C is fitted to nodes at rest.
Without a rectangle known to be at rest, these are the quietest nodes of the view's border: rubber's far
field falls off like 1/r or faster, so a node of residual slope s at distance r from the dent is at most
s r deep. That bound weights the nodes. What depth they still have, and how well that is known, follows from
the decay of slope and depth over the view (`far_field`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import cv2
import numpy as np

from zeromethod.arrays import Float, Ints, Mask, Single
from zeromethod.rig.model import KnownRest
from zeromethod.surface.node_passes import diagonal
from zeromethod.surface.quiet import (
    agreeing,
    mask,
    over_noise,
    quiet_nodes,
    quiet_sums,
    shortest_interval,
    squared,
)
from zeromethod.warp.overlap import shared_nodes

_BLOCK_SHARE = 0.056
"""Block over which slope is averaged before it is judged, relative to the lattice's shorter side."""
_RING_SHARE = 0.16
"""Width of the border ring relative to the lattice's shorter side."""
_CORE_SHARE = 0.6
"""Share of the ring's weight that must agree on the constant: a smaller flat top is outvoted."""
_MIN_NODES = 16
"""Nodes of the ring below which all of the island serves as the ring."""
_SAME_MM, MOST_CHOICES = 5e-8, 8
"""Change of the anchor's depth below which its nodes are the same, and how often they are chosen at most."""
_LEAST_FALL, _USUAL_FALL, _MOST_FALL = 0.1, 0.8, 2.0
"""Bounds of the secant's slope, and its value in the first step: decrease of a choice's error per multiple of
the gradient that is taken out of the slopes."""


@dataclass(frozen=True, slots=True)
class RestFit:
    """Weights (rows, cols), adding up to 1, of depth / h in the constant C; its systematic sigma in mm.

    far_field_mm: assumed mean of depth / h with these weights; 0 where the nodes count as at rest.
    hidden_mm: what of it noise can hide; 0 where nothing presses.
    """

    mode: Literal["known", "quiet", "loads"]
    weights: Float
    sigma_mm: float
    far_field_mm: float = 0.0
    hidden_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class NodeReadings:
    """What was read, (rows, cols): depth, h, variance of depth / h, mm^2; slope, its variance (..., 2)."""

    x_mm: Float
    y_mm: Float
    depth_mm: Float
    scale: Float
    noise2: Float
    slope: Float
    variance: Float


def known_nodes(known_rest: Sequence[KnownRest], x_mm: Float, y_mm: Float) -> Mask:
    """Nodes (rows, cols) whose mirror point lies in a rectangle known to be at rest."""
    inside = np.zeros(x_mm.shape, bool)
    for part in known_rest:
        inside |= (
            (x_mm >= part.x_mm[0]) & (x_mm <= part.x_mm[1]) & (y_mm >= part.y_mm[0]) & (y_mm <= part.y_mm[1])
        )
    return inside


def fit_known(nodes: Mask, scale: Float) -> RestFit:
    """Least squares of depth = C h over nodes known to be at rest; its sigma is that of `known_misfit`."""
    weights = np.where(nodes, scale**2, 0.0)
    return RestFit("known", weights / weights.sum(), 0.0)


def known_misfit(
    fit: RestFit, reading: NodeReadings, known_rest: Sequence[KnownRest], overlap: float
) -> tuple[RestFit, Float]:
    """The fit with sigma by how far its nodes are from rest after all, and the error that implies elsewhere.

    They are not at rest where the bench moved, or a rim is not clamped. All depths may be off by as much as
    theirs are beyond noise. Their mean slope, 0 at rest, may go on to other nodes: an error that grows with
    the distance from the nearest known place, (rows, cols) mm of depth / h, 0 in the places. overlap: number
    of nodes that share their noise.
    """
    w, x, y = fit.weights, reading.x_mm, reading.y_mm
    off2 = float((w * ((reading.depth_mm / reading.scale) ** 2 - reading.noise2))[w > 0.0].sum())
    nearest, steepest = np.full(x.shape, np.inf), 0.0
    for place in known_rest:
        inside = known_nodes([place], x, y) & (w > 0.0)
        if not inside.any():
            continue
        away = [
            np.maximum(np.maximum(r[0] - c, c - r[1]), 0.0) for r, c in ((place.x_mm, x), (place.y_mm, y))
        ]
        nearest = np.minimum(nearest, np.hypot(*away))
        mean = reading.slope[inside].mean(axis=0)
        noise2 = overlap * float(reading.variance[inside].mean(axis=0).sum()) / np.count_nonzero(inside)
        steepest = max(steepest, float(mean @ mean) - 4.0 * noise2)
    elsewhere = np.where(np.isfinite(nearest), nearest, 0.0) * np.sqrt(steepest)
    return replace(fit, sigma_mm=float(np.sqrt(max(off2, 0.0)))), elsewhere / reading.scale


class Border:
    """The border ring of one island, in which anchors are looked for, and the gradient's sums over blocks."""

    def __init__(self, island: Mask, gradient: Float, correlation: Float) -> None:
        """gradient: (rows, cols, 2) of the scale h, 1/mm. correlation: of noise 0, 1, 2, ... nodes apart."""
        self.island, self.gradient = island.copy(), gradient
        width = max(2, round(_RING_SHARE * min(island.shape)))
        ring = island.copy()
        ring[width:-width, width:-width] = False
        self.ring = ring if np.count_nonzero(ring) >= _MIN_NODES else self.island
        self.block = 2 * max(1, round(0.5 * _BLOCK_SHARE * min(island.shape))) + 1
        self.correlated, self.shared = len(correlation), shared_nodes(correlation)
        self.nodes = np.count_nonzero(island)
        self.gradients = self.means(gradient, np.ones((*island.shape, 1)))
        per_share2 = 1.0 / np.maximum(self.gradients[..., 2].astype(np.float64), 1.0 / self.block**2) ** 2
        self.averaging = mean_noise_gain(correlation, self.block) ** 2 * per_share2
        self.per_share2 = np.asarray(per_share2 * island, np.float32)

    def means(self, vectors: Float, other: Float) -> Single:
        """Means (rows, cols, 3) over blocks, of vectors (rows, cols, 2) and sums of (rows, cols, n).

        Those are on the island, else 0.
        """
        masked = np.empty((*self.island.shape, 3), np.float32)
        mask(vectors, other, self.island, masked)
        size = self.block, self.block
        return np.asarray(cv2.boxFilter(masked, -1, size, borderType=cv2.BORDER_CONSTANT), np.float32)

    def around(self, values: Single) -> Single:
        """Largest (rows, cols) of a block."""
        return np.asarray(cv2.dilate(values, np.ones((self.block, self.block), np.uint8)), np.float32)


class _Choice(NamedTuple):
    """One choice of quiet nodes.

    at_mm: their mean depth / h with `weights` (rows, cols). nodes: their flat numbers. deepest: node. slope2:
    (rows, cols) squared slope of the blocks, by which they were chosen.
    """

    at_mm: float
    weights: Float
    nodes: Ints
    deepest: tuple[int, int]
    slope2: Single


class QuietNodes:
    """Finds the quietest nodes in the border of one reading."""

    def __init__(
        self,
        border: Border,
        slope: Float,
        variance: Float,
        constant_mm: Float,
        scale: Float,
        x_mm: Float,
        y_mm: Float,
    ) -> None:
        """slope, variance: (rows, cols, 2) of a depth's slope, rad, rad^2; constant_mm: that depth over h."""
        self._border, self._slope, self._variance = border, slope, variance
        self._constant, self._scale = constant_mm, scale
        self._place = x_mm, y_mm
        # a single node has no extent and needs no weight
        self._least2 = (0.25 * diagonal(x_mm, y_mm, border.island)) ** 2 or 1.0
        self._means = border.means(slope, variance)

    def fit(self, contained_mm: float, most: int = MOST_CHOICES) -> tuple[RestFit, float]:
        """The quiet nodes, and their mean of depth / h, mm.

        They are chosen by their slopes less a multiple of the gradient of h: first contained_mm, then, by
        secants, the mean that the choice itself gives, until the two agree.
        """
        step_mm = off_mm = 0.0
        for k in range(most):
            chosen = self._choose(contained_mm)
            before_mm, off_mm = off_mm, chosen.at_mm - contained_mm
            if abs(off_mm) < _SAME_MM:
                break
            falls = min(max((before_mm - off_mm) / step_mm, _LEAST_FALL), _MOST_FALL) if k else _USUAL_FALL
            step_mm = off_mm / falls
            contained_mm += step_mm
        return self._bounded(chosen), chosen.at_mm

    def _choose(self, contained_mm: float) -> _Choice:
        border = self._border
        slope2 = np.empty(border.island.shape, np.float32)
        squared(self._means, border.gradients, contained_mm, border.per_share2, slope2)
        # the largest nearby, as a dent's centre is flat too
        fields = border.around(slope2), self._means, border.averaging, self._constant, self._scale
        nodes, values, heavy, deepest = quiet_nodes(
            *fields, *self._place, border.ring, border.island, self._least2
        )
        weights = np.zeros(border.island.shape)
        core = shortest_interval(values, heavy, np.argsort(values), _CORE_SHARE)
        return _Choice(agreeing(nodes, values, heavy, *core, weights), weights, nodes, deepest, slope2)

    def _bounded(self, chosen: _Choice) -> RestFit:
        """The fit, with a bound of the depth that its nodes may still have as its sigma."""
        border, shared = self._border, self._border.shared
        read = self._slope, border.gradient, chosen.at_mm, self._variance
        # whether the slopes are more than noise
        least = 1.0 + 5.0 * float(np.sqrt(shared / border.nodes))
        if not over_noise(*read, border.island) > 2 * border.nodes * least:
            return RestFit("quiet", chosen.weights, 0.0)
        nodes = chosen.nodes, chosen.weights, *self._place, chosen.deepest, self._least2, self._scale
        around = chosen.slope2, self._means, border.averaging
        implied, own, seen, noise, squares = quiet_sums(*nodes, *read, *around)
        # Mean depth / h by the slope if depth decays as 1/r around the deepest node: depth A/r has radial
        # slope -depth/r. Only the part above twice its noise counts; a field that decays faster is
        # overestimated.
        signed = np.sqrt(max(implied * implied - 4.0 * shared * own, 0.0))
        blocks = 1.0 / squares / (border.block + border.correlated) ** 2
        # A bound without direction, for dents that fill the view, less the part that noise can cause.
        hidden = noise * 3.0 * np.sqrt(2.0 / max(blocks, 1.0))
        unsigned = np.sqrt(max(seen - noise - hidden, 0.0))
        return RestFit("quiet", chosen.weights, float(max(signed, unsigned)), 0.0, float(np.sqrt(hidden)))


def mean_noise_gain(correlation: Float, count: int) -> float:
    """Variance of the mean of `count` neighbours on a line, each of variance 1, with this correlation."""
    lags = np.arange(count)
    rho = np.zeros(count)
    rho[: min(count, len(correlation))] = correlation[:count]
    pairs = np.where(lags == 0, count, 2 * (count - lags))
    return float((pairs * rho).sum() / count**2)
