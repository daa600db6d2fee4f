"""Nodes that fail again and again: what they measure is too fine or too steep for the sensing window.

A dent narrower than the window is measured while the picture over it is smooth; drawn, it makes the window
fail, the picture is continued smoothly, and so on: the picture swings for ever. A moving target is read pixel
by pixel, which needs a picture that stands: such nodes are followed slowly, and stay as they are once they
fail.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Flags, Ints, Mask
from zeromethod.warp.validity import Flag

FAILURES = 2
"""Failures within `WITHIN_S`, each after a frame in which the node was valid, that make it unsteady."""
WITHIN_S = 0.7
KEPT_S = 5.0
"""How long a node is followed slowly after it failed last."""
_NOT_THE_WINDOW = np.uint16(Flag.OUTSIDE | Flag.NO_RAY | Flag.MIXED | Flag.CODED)


class UnsteadyNodes:
    """Counts the failures of nodes (rows, cols) from frame to frame."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._valid: Mask = np.zeros(shape, bool)
        self._failures: Ints = np.zeros(shape, np.int64)
        self._since_ns: Ints = np.zeros(shape, np.int64)
        self._until_ns: Ints = np.zeros(shape, np.int64)

    def learn(self, flags: Flags, time_ns: int) -> Mask | None:
        """Take in a frame's flags; (rows, cols) nodes to be followed slowly, None for none."""
        failed = self._valid & (flags != 0) & (flags & _NOT_THE_WINDOW == 0)
        self._valid = flags == 0
        if failed.any():
            late = time_ns - self._since_ns > 1e9 * WITHIN_S
            self._failures[failed & late] = 0
            self._since_ns[failed & (self._failures == 0)] = time_ns
            self._failures[failed] += 1
            self._until_ns[failed & (self._failures >= FAILURES)] = time_ns + round(1e9 * KEPT_S)
        unsteady = self._until_ns > time_ns
        return _with_neighbours(unsteady) if unsteady.any() else None


def _with_neighbours(nodes: Mask) -> Mask:
    """The nodes and those next to them."""
    out = nodes.copy()
    out[1:] |= nodes[:-1]
    out[:-1] |= nodes[1:]
    wide = out.copy()
    wide[:, 1:] |= out[:, :-1]
    wide[:, :-1] |= out[:, 1:]
    return wide
