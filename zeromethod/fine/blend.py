"""Nodes from windows in space and time: how far the last frames may be averaged, node by node.

A mirror that stands is read by the fit of all frames, one that moves by its newest frame. The share w of the
former is Wiener's: with coarse readings of variance s^2 that scatter over the frames by s^2 + b^2, what the
mean is off by is b, and (1 - w)^2 s^2 + w^2 b^2 is least at w = s^2 / (s^2 + b^2).
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask

_POOL_NODES = 9
_CHANCE = 4.0
"""Standard deviations of chance below which scatter counts as noise."""
_INDEPENDENT = 9.0
"""Nodes that share their noise, as their windows overlap (`warp.overlap.shared_nodes`)."""


def fine_share(warps: Float, sigma: Float, valid: Mask) -> Float:
    """Share w (rows, cols), 0..1, of the fit of all frames; 1 where nothing moved, 0 off `valid`.

    warps: (N, rows, cols, 2) LCD px, coarse readings. sigma: the same shape, of each. valid: (rows, cols).
    """
    count = len(warps)
    good = valid & np.isfinite(warps).all(axis=(0, -1)) & np.isfinite(sigma).all(axis=(0, -1))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scatter2 = warps.var(axis=0, ddof=1) / np.mean(sigma**2, axis=0)
    excess = np.where(good, scatter2.mean(axis=-1), 0.0)
    size = _POOL_NODES, _POOL_NODES
    nodes = cv2.boxFilter(good.astype(np.float64), -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
    pooled = cv2.boxFilter(excess, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
    pooled = np.asarray(pooled) / np.maximum(nodes, 1.0) - 1.0
    chance = np.sqrt(2.0 / (2.0 * (count - 1) * np.maximum(nodes / _INDEPENDENT, 1.0)))
    moved = np.maximum(pooled - _CHANCE * chance, 0.0)
    return np.where(good, 1.0 / (1.0 + moved), 0.0)


def blend(coarse: Float, fine: Float, share: Float) -> Float:
    """Coarse values (rows, cols, 2) with a share (rows, cols) of the fine ones, where those are finite."""
    return np.where(
        np.isfinite(fine) & (share[..., None] > 0.0), coarse + share[..., None] * (fine - coarse), coarse
    )


def blended_variance(coarse: Float, fine: Float, share: Float, count: int) -> Float:
    """Variance (rows, cols, 2) of `blend`, the coarse frame being the newest of the fine reading's."""
    w = share[..., None]
    moved = coarse * (1.0 / np.maximum(w, 1e-3) - 1.0)
    with np.errstate(invalid="ignore"):  # infinite where a node was not measured
        own = (1.0 - w) ** 2 * coarse + w**2 * (fine + moved) + 2.0 * w * (1.0 - w) * coarse / count
    return np.where(np.isfinite(fine) & (w > 0.0), own, coarse)
