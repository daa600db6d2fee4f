"""Mean of measured warps of a stationary mirror."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from zeromethod.arrays import Flags, Float, Mask
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
        self._valid = _Sums()
        self._all = _Sums()
        self._flags: Flags = np.zeros((), np.uint16)
        self._time_ns = 0

    def add(self, warp: Warp) -> None:
        """Add a warp."""
        self.frames += 1
        self._valid.add(warp, warp.valid[..., None])
        self._all.add(warp, np.True_)
        self._flags = self._flags | warp.flags
        self._time_ns += warp.time_ns

    @property
    def warp(self) -> Warp:
        """Mean of the warps added, at least one."""
        enough = self._valid.count >= LEAST_SHARE * self.frames
        (q, sigma), (q_all, sigma_all) = self._valid.mean(), self._all.mean()
        flags = np.where(enough[..., 0], np.uint16(0), self._flags)
        return Warp(
            np.where(enough, q, q_all),
            np.where(enough, sigma, sigma_all),
            flags,
            self._time_ns // self.frames,
        )


class _Sums:
    """Sums over the warps in which a node is used."""

    def __init__(self) -> None:
        self.count: Float = np.zeros(())
        self._q: Float = np.zeros(())
        self._variance: Float = np.zeros(())

    def add(self, warp: Warp, used: Mask | np.bool_) -> None:
        self.count = self.count + used
        self._q = self._q + np.where(used, warp.q, 0.0)
        self._variance = self._variance + np.where(used, warp.sigma, 0.0) ** 2

    def mean(self) -> tuple[Float, Float]:
        """Mean of q and its sigma; 0 where nothing was added."""
        count = np.maximum(self.count, 1.0)
        return self._q / count, np.sqrt(self._variance) / count


def mean_warp(warps: Iterable[Warp]) -> Warp:
    """Mean of at least one warp; see `RunningMean`."""
    mean = RunningMean()
    for warp in warps:
        mean.add(warp)
    return mean.warp
