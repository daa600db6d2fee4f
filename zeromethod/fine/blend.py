"""Nodes from windows in space and time: how far the last frames may be averaged, node by node.

A mirror that stands is read by the fit of all frames, one that moves steadily by the end of a line or a
polynomial through them (`fine.motion`), any other by its newest frame. The share w of the former is Wiener's:
with coarse readings of variance s^2, and an end that is off by b, (1 - w)^2 s^2 + w^2 b^2 is least at
w = s^2 / (s^2 + b^2). b is that of the next power of time that scatters as readings do beyond noise.

A mirror that stands scatters, too, where it is finer than the window: what the window does not average out is
seen at the phases p, q of the target, as waves of p, 2 p and p +- q along u. So motion is at most what
scatters but for these, over what those would leave of a steady one.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float
from zeromethod.fine.motion import INDEPENDENT, Readings, pooled

_CHANCE = 4.0
"""Standard deviations of chance below which scatter counts as noise."""
_AROUND_NODES = 13
"""Nodes along each side within which the largest motion beyond a polynomial counts."""


def fine_share(seen: Readings, degree: int = 0) -> Float:
    """Share w (rows, cols), 0..1, of the fit of all frames; 1 where nothing moved, 0 off good nodes.

    degree: of the polynomial in time that is fitted; 0: the mean.
    """
    nodes = seen.around()
    chance = _CHANCE / np.sqrt(np.maximum(nodes / INDEPENDENT, 1.0))
    moved = np.full(nodes.shape, np.inf)
    for fit in seen.fits:
        excess, free = fit.excess - 0.5 * (fit.powers[:degree] ** 2).sum(axis=(0, -1)), fit.free - degree
        beyond = pooled(excess) / nodes - free - chance * np.sqrt(free)
        # at its end the next power is off by this part of its square over the frames
        end2 = seen.powers[-1, degree + 1] ** 2 / fit.left[degree]
        moved = np.minimum(moved, np.maximum(beyond, 0.0) * end2)
    if degree:
        moved = cv2.dilate(moved, np.ones((_AROUND_NODES, _AROUND_NODES), np.uint8))
    return np.where(seen.good, 1.0 / (1.0 + moved), 0.0)


def blend(coarse: Float, fine: Float, share: Float) -> Float:
    """Coarse values (rows, cols, 2) with a share (rows, cols) of the fine ones, where those are finite."""
    return np.where(
        np.isfinite(fine) & (share[..., None] > 0.0), coarse + share[..., None] * (fine - coarse), coarse
    )


def blended_variance(coarse: Float, fine: Float, share: Float, common: float) -> Float:
    """Variance (rows, cols, 2) of `blend`.

    common: weight of the coarse frame, the newest, in the fine reading.
    """
    w = share[..., None]
    moved = coarse * (1.0 / np.maximum(w, 1e-3) - 1.0)
    with np.errstate(invalid="ignore"):  # infinite where a node was not measured
        own = (1.0 - w) ** 2 * coarse + w**2 * (fine + moved) + 2.0 * w * (1.0 - w) * coarse * common
    return np.where(np.isfinite(fine) & (w > 0.0), own, coarse)
