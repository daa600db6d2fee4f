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
from typing import Literal

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import KnownRest
from zeromethod.surface.quiet import agreeing, block_slope, quiet_sums, quiet_weights
from zeromethod.warp.overlap import shared_nodes

_BLOCK_SHARE = 0.056
"""Block over which slope is averaged before it is judged, relative to the lattice's shorter side."""
_RING_SHARE = 0.16
"""Width of the border ring relative to the lattice's shorter side."""
_CORE_SHARE = 0.6
"""Share of the ring's weight that must agree on the constant: a smaller flat top is outvoted."""
_MIN_NODES = 16


@dataclass(frozen=True, slots=True)
class RestFit:
    """Weights (rows, cols), adding up to 1, of depth / h in the constant C; its systematic sigma in mm.

    far_field_mm: assumed mean of depth / h with these weights; 0 where the nodes count as at rest.
    hidden_mm: what of it noise can hide; 0 where nothing presses.
    """

    mode: Literal["known", "quiet"]
    weights: Float
    sigma_mm: float
    far_field_mm: float = 0.0
    hidden_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class KnownReading:
    """What was read, (rows, cols): depth and h, noise of depth / h, mm; slope and its variance (..., 2)."""

    x_mm: Float
    y_mm: Float
    depth_mm: Float
    scale: Float
    noise_mm: Float
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
    fit: RestFit, reading: KnownReading, known_rest: Sequence[KnownRest], overlap: float
) -> tuple[RestFit, Float]:
    """The fit with what its nodes are in fact off rest in its sigma, and what that may be elsewhere.

    Nodes off rest are a bench that moved, or a rim that is not clamped. Their depths, beyond noise, are off
    by as much everywhere. Their mean slope, which at rest is 0, goes on to other nodes with the distance from
    the nearest place known: (rows, cols) mm of depth / h, 0 in the places. overlap: number of nodes that
    share their noise.
    """
    w, x, y = fit.weights, reading.x_mm, reading.y_mm
    off2 = float((w * ((reading.depth_mm / reading.scale) ** 2 - reading.noise_mm**2))[w > 0.0].sum())
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


def fit_quiet(
    slope: Float,
    variance: Float,
    depth_mm: Float,
    scale: Float,
    x_mm: Float,
    y_mm: Float,
    island: Mask,
    correlation: Float,
) -> RestFit:
    """Weights of the quietest nodes in the border ring.

    slope, variance: (rows, cols, 2) of depth's slope, rad and rad^2. depth_mm: any depth with that slope.
    scale: h. correlation: of the noise of nodes 0, 1, 2, ... apart along one axis.
    """
    width = max(2, round(_RING_SHARE * min(island.shape)))
    ring = island.copy()
    ring[width:-width, width:-width] = False
    if np.count_nonzero(ring) < _MIN_NODES:
        ring = island
    constant = depth_mm / scale
    block = 2 * max(1, round(0.5 * _BLOCK_SHARE * min(island.shape))) + 1
    averaging = mean_noise_gain(correlation, block) ** 2
    slope2, noise2, ratio = block_slope(slope, variance, island, averaging, block)
    # the largest nearby, as a dent's centre is flat too
    nearby = np.asarray(cv2.dilate(slope2, np.ones((block, block), np.uint8)), np.float64)
    weights, away, lever2, values, heavy = quiet_weights(
        nearby, noise2, constant, scale, x_mm, y_mm, ring, island
    )
    agreeing(weights, constant, *_shortest_interval(values, heavy))
    shared = shared_nodes(correlation)
    # whether the slopes are more than noise
    if not ratio > 1.0 + 5.0 * float(np.sqrt(shared / np.count_nonzero(island))):
        return RestFit("quiet", weights, 0.0)
    implied, own, seen, noise, squares = quiet_sums(
        weights, away, lever2, scale, slope, variance, slope2, noise2
    )
    # Mean depth / h by the slope if depth decays as 1/r around the deepest node: depth A/r has radial slope
    # -depth/r. Only the part above twice its noise counts; a field that decays faster is overestimated.
    signed = np.sqrt(max(implied * implied - 4.0 * shared * own, 0.0))
    blocks = 1.0 / squares / (block + len(correlation)) ** 2
    # A bound without direction, for dents that fill the view, less the part that noise can cause.
    hidden = noise * 3.0 * np.sqrt(2.0 / max(blocks, 1.0))
    unsigned = np.sqrt(max(seen - noise - hidden, 0.0))
    return RestFit("quiet", weights, float(max(signed, unsigned)), 0.0, float(np.sqrt(hidden)))


def mean_noise_gain(correlation: Float, count: int) -> float:
    """Variance of the mean of `count` neighbours on a line, each of variance 1, with this correlation."""
    lags = np.arange(count)
    rho = np.zeros(count)
    rho[: min(count, len(correlation))] = correlation[:count]
    pairs = np.where(lags == 0, count, 2 * (count - lags))
    return float((pairs * rho).sum() / count**2)


def _shortest_interval(values: Float, weights: Float) -> tuple[float, float]:
    """Shortest interval that contains the core share of the weight."""
    order = np.argsort(values)
    values, total = values[order], np.cumsum(weights[order])
    start = np.concatenate([[0.0], total[:-1]])
    end = np.searchsorted(total, start + _CORE_SHARE * total[-1] * (1 - 1e-12))
    fits = end < len(values)
    first, last = np.flatnonzero(fits), end[fits]
    best = int(np.argmin(values[last] - values[first]))
    return float(values[first[best]]), float(values[last[best]])
