"""Where depth's constant comes from: a rim declared to be at rest, or the loads that explain the slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.rig.model import KnownRest


def _no_constant(_slope: Float, _ratio: Float) -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class RestFit:
    """Weights (rows, cols), adding up to 1, of depth / h whose mean is known; its systematic sigma in mm.

    far_field_mm: that mean; 0 where the nodes count as at rest. false_constant: what slopes (rows, cols, 2)
    that no mirror makes, read as depth / h of that mean 0, add to the constant, mm.
    """

    mode: Literal["known", "loads"]
    weights: Float
    sigma_mm: float
    far_field_mm: float = 0.0
    false_constant: Callable[[Float, Float], float] = _no_constant


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
