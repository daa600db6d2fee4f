"""Mean of measured warps of a stationary mirror."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from zeromethod.arrays import Flags, Float
from zeromethod.warp.warp import Warp

LEAST_SHARE = 0.5
"""Share of the warps in which a node must be valid for its mean to be."""


class RunningMean:
    """Mean, node by node, over the warps in which the node is valid, with its sigma.

    Nodes valid in fewer than half of the warps have all their flags and the mean of all. Next to a fold,
    nodes alternate between valid and invalid: excluding all that ever were invalid would lose the flank.
    """

    def __init__(self) -> None:
        self.frames = 0
        # over the warps in which a node is valid, and over all
        self._count: Float = np.zeros(())
        self._q: Float = np.zeros(())
        self._variance: Float = np.zeros(())
        self._flags: Flags = np.zeros((), np.uint16)
        self._time_ns = 0

    def add(self, warp: Warp) -> None:
        """Add a warp."""
        used = np.stack([warp.valid, np.ones_like(warp.valid)])[..., None]
        self.frames += 1
        self._count = self._count + used
        self._q = self._q + np.where(used, warp.q, 0.0)
        self._variance = self._variance + np.where(used, warp.sigma, 0.0) ** 2
        self._flags = self._flags | warp.flags
        self._time_ns += warp.time_ns

    @property
    def warp(self) -> Warp:
        """Mean of the warps added, at least one."""
        count = np.maximum(self._count, 1.0)
        enough = self._count[0] >= LEAST_SHARE * self.frames
        q, sigma = (
            np.where(enough, mean[0], mean[1]) for mean in (self._q / count, np.sqrt(self._variance) / count)
        )
        flags = np.where(enough[..., 0], np.uint16(0), self._flags)
        return Warp(q, sigma, flags, self._time_ns // self.frames)


def mean_warp(warps: Iterable[Warp]) -> Warp:
    """Mean of at least one warp; see `RunningMean`."""
    mean = RunningMean()
    for warp in warps:
        mean.add(warp)
    return mean.warp
