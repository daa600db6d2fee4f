"""The mean of measured warps of a mirror that stands still."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.warp.warp import Warp

LEAST_SHARE = 0.5
"""Share of the warps in which a node must be valid for its mean to be."""


def mean_warp(warps: Sequence[Warp]) -> Warp:
    """Mean, node by node, over the warps in which the node is valid, with its sigma.

    Nodes valid in fewer than half of the warps carry all their flags and the mean of all. Beside a fold,
    nodes flicker between valid and not: leaving out every one that ever did would lose the flank.
    """
    flags = np.bitwise_or.reduce([warp.flags for warp in warps])
    valid = np.stack([warp.valid for warp in warps])
    enough = valid.mean(axis=0) >= LEAST_SHARE
    used = np.where(enough, valid, True)[..., None].astype(np.float64)
    count = used.sum(axis=0)

    def mean(values: list[np.ndarray]) -> np.ndarray:
        return np.asarray(np.where(used > 0, np.stack(values), 0.0).sum(axis=0) / count)

    q = mean([warp.q for warp in warps])
    sigma = np.sqrt(mean([warp.sigma**2 for warp in warps]) / count)
    flags = np.where(enough, np.uint16(0), flags)
    return Warp(q, sigma, flags, int(np.mean([warp.time_ns for warp in warps])))
