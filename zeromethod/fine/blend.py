"""Nodes from windows in space and time: how far the last frames may be averaged, node by node.

A mirror that stands is read by the fit of all frames, one that moves by its newest frame. The share w of the
former is Wiener's: with coarse readings of variance s^2 that scatter over the frames by s^2 + b^2, what the
mean is off by is b, and (1 - w)^2 s^2 + w^2 b^2 is least at w = s^2 / (s^2 + b^2).

A mirror that stands scatters, too, where it is finer than the window: what the window does not average out is
seen at the phases p, q of the target, as waves of p, 2 p and p +- q along u. Their share of the scatter is
left out, and motion is judged by what the rest would have of a steady one.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask

_POOLS_NODES = 9, 33
"""Sides of squares in which scatter is pooled: the motion of a narrow shape, and a slow one of a wide."""
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
    excess, free, left = np.zeros(good.shape), 0.0, 0.0
    for axis in (0, 1):
        own, other = turns[..., axis], turns[..., 1 - axis]
        waves = _orthonormal((own, 2 * own, own + other, own - other))
        still = d[..., axis] - d[..., axis].mean(axis=0)
        with np.errstate(invalid="ignore"):
            squares = (still**2).sum(axis=0) - (np.einsum("rtk,trc->rkc", waves, still) ** 2).sum(axis=1)
        drift = np.linspace(-1.0, 1.0, len(d))
        kept = 1.0 - ((drift @ waves) ** 2).sum(axis=-1) / (drift @ drift)
        free = len(d) - waves.shape[-1]
        with np.errstate(invalid="ignore", divide="ignore"):
            excess += squares / variance[..., axis]
        left += 0.5 * len(d) * float(kept.mean())
    excess = np.where(good, 0.5 * excess - free, 0.0)
    moved = np.zeros(good.shape)
    for side in _POOLS_NODES:
        nodes, pooled = (_pooled(one, side) for one in (good.astype(np.float64), excess))
        chance = np.sqrt(free / np.maximum(nodes / _INDEPENDENT, 1.0))
        moved = np.maximum(moved, (pooled / np.maximum(nodes, 1.0) - _CHANCE * chance) / left)
    return np.where(good, 1.0 / (1.0 + moved), 0.0)


def _pooled(values: Float, side: int) -> Float:
    size = side, side
    return np.asarray(cv2.boxFilter(values, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def _orthonormal(phases: tuple[Float, ...]) -> Float:
    """(rows, N, k) of the constant and waves (N, rows) of time; the constant alone where frames are few."""
    waves = [np.ones_like(phases[0]), *(f(one) for one in phases for f in (np.cos, np.sin))]
    count = len(phases[0])
    basis = np.stack(waves if count >= 2 * len(waves) else waves[:1], axis=-1)
    return np.asarray(np.linalg.qr(np.swapaxes(basis, 0, 1))[0])


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
