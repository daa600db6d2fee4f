"""Noise correlation of neighbouring nodes, whose sensing windows overlap.

A node's displacement is a sum of pixels, weights w_k c_k with w the triangle window (P - |k|) and c the
gradient of the pattern: a sine of the carrier's phase for the displacement along the carrier, 1 across it.
Pixels' noise is independent, so nodes L px apart share sum w_k w_(k-L) c_k^2 of it. Near null the carriers'
phases are those of the target itself, c^2 repeats from node to node and the correlation is one and the same
over the whole lattice.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from zeromethod.arrays import Float

Gradient = Literal["flat", "sine", "cosine"]

_GRADIENTS: dict[str, tuple[Gradient, Gradient]] = {
    "cosines": ("sine", "flat"),
    "lattice": ("sine", "flat"),
    "checker": ("sine", "cosine"),  # sin(a + b) + sin(a - b) = 2 sin a cos b
    "noise": ("flat", "flat"),
}


def overlap_correlation(period_px: int, spacing_px: int, gradient: Gradient = "flat") -> Float:
    """Correlation of one component's noise between nodes 0, 1, 2, ... apart along one axis.

    "flat": the cubic B-spline 1, 0.719, 0.25, 0.031, 0 at half a period per node. "sine", "cosine": with the
    carrier in the weights, which changes it by up to 4 %.
    """
    k = np.arange(-period_px, period_px + 1)
    phase = 2 * np.pi * k / period_px
    c2 = {"flat": np.ones(k.size), "sine": np.sin(phase) ** 2, "cosine": np.cos(phase) ** 2}[gradient]
    w = (period_px - np.abs(k)).astype(np.float64)
    lags = range(0, 2 * period_px, spacing_px)
    shared = [float((w[lag:] * w[: w.size - lag] * c2[lag:]).sum()) for lag in lags]
    return np.array([*shared, 0.0]) / shared[0]


def shared_nodes(correlation: Float) -> float:
    """Number of nodes that share a node's noise, over the lattice, by its `correlation` along either axis."""
    return (2.0 * float(correlation.sum()) - 1.0) ** 2


def component_correlation(period_px: int, spacing_px: int, kind: str) -> tuple[Float, Float]:
    """(along its own axis, along the other) correlation of a displacement component for a kind of target.

    The two axes multiply; the two components of the displacement are independent.
    """
    own, other = _GRADIENTS[kind]
    return (
        overlap_correlation(period_px, spacing_px, own),
        overlap_correlation(period_px, spacing_px, other),
    )


def mean_noise_gain(correlation: Float, count: int) -> float:
    """Variance of the mean of `count` neighbours on a line, each of variance 1, with this correlation."""
    lags = np.arange(count)
    rho = np.zeros(count)
    rho[: min(count, len(correlation))] = correlation[:count]
    pairs = np.where(lags == 0, count, 2 * (count - lags))
    return float((pairs * rho).sum() / count**2)
