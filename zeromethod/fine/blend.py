"""Nodes from windows in space and time: how far the last frames may be averaged, node by node.

A mirror that stands is read by the fit of all frames, one that moves by its newest frame. The share w of the
former is Wiener's: with coarse readings of variance s^2 that scatter over the frames by s^2 + b^2, what the
mean is off by is b, and (1 - w)^2 s^2 + w^2 b^2 is least at w = s^2 / (s^2 + b^2).

A mirror that stands scatters, too, where it is finer than the window: what the window does not average out is
seen at the phases p, q of the target, as waves of p, 2 p and p +- q along u. So motion is at most what
scatters but for these, over what those would leave of a steady one.
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


def fine_share(d: Float, variance: Float, valid: Mask, turns: Float) -> Float:
    """Share w (rows, cols), 0..1, of the fit of all frames; 1 where nothing moved, 0 off `valid`.

    d: (N, rows, cols, 2) coarse readings against the same warp, camera px. variance: (rows, cols, 2) px^2 of
    one, in the mean. valid: (rows, cols). turns: (N, rows, 2) phases of the target, rad.
    """
    good = valid & np.isfinite(d).all(axis=(0, -1)) & np.isfinite(variance).all(axis=-1)
    still = np.where(good[..., None], (d - d.mean(axis=0)) / np.sqrt(variance), 0.0)
    size = _POOL_NODES, _POOL_NODES
    nodes = cv2.boxFilter(good.astype(np.float64), -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
    nodes = np.maximum(nodes, 1.0)
    chance = _CHANCE / np.sqrt(np.maximum(nodes / _INDEPENDENT, 1.0))
    u, v = turns[..., 0], turns[..., 1]
    moved = np.full(good.shape, np.inf)
    for phases in ((), ((u, 2 * u, u + v, u - v), (v, 2 * v, u + v, u - v))):
        excess, left, free = np.zeros(good.shape), 0.0, 0.0
        for axis in (0, 1):
            waves = _orthonormal(u, *(phases[axis] if phases else ()))
            explained = np.einsum("rtk,trc->rkc", waves, still[..., axis])
            free += 0.5 * (len(d) - waves.shape[-1])
            left += 0.5 * len(d) * _left_of_drift(waves)
            excess += 0.5 * ((still[..., axis] ** 2).sum(axis=0) - (explained**2).sum(axis=1))
        pooled = cv2.boxFilter(excess, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        beyond = np.asarray(pooled) / nodes - free - chance * np.sqrt(free)
        moved = np.minimum(moved, np.maximum(beyond, 0.0) / left)
    return np.where(good, 1.0 / (1.0 + moved), 0.0)


def _orthonormal(like: Float, *phases: Float) -> Float:
    """(rows, N, k) of the constant and waves (N, rows) of time; the constant alone where frames are few."""
    waves = [np.ones_like(like), *(f(one) for one in phases for f in (np.cos, np.sin))]
    few = len(like) < 2 * len(waves)
    basis = np.stack(waves[:1] if few else waves, axis=-1)
    return np.asarray(np.linalg.qr(basis.swapaxes(0, 1))[0])


def _left_of_drift(waves: Float) -> float:
    """Share of a steady motion's scatter that waves (rows, N, k) leave, in the mean over rows."""
    drift = np.linspace(-1.0, 1.0, waves.shape[1])
    return float(1.0 - np.mean(((drift @ waves) ** 2).sum(axis=-1)) / (drift @ drift))


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
