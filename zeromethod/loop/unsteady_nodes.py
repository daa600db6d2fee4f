"""Nodes that fail again and again: what they measure is too fine or too steep for the sensing window.

A dent narrower than the window is measured while the picture over it is smooth; drawn, it makes the window
fail, the picture is continued smoothly, and so on: the picture swings for ever. A moving target is read pixel
by pixel, which needs a picture that stands: such nodes are followed slowly, and stay as they are once they
fail. So does the picture next to a saw's seam that a slope opened, for as long as the mirror is at rest.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.loop.failing_nodes import grown
from zeromethod.loop.node_figures import quiet_share
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

FAILURES = 2
"""Failures within `WITHIN_S`, each after a frame in which the node was valid, that make it unsteady."""
WITHIN_S = 0.7
KEPT_S = 5.0
"""How long a node is followed slowly after it failed last."""
QUIET_LCD_PX, QUIET_SHARE = 0.1, 0.9
"""The mirror is at rest while so many of the other nodes stay to within this from frame to frame."""
_NOT_THE_WINDOW = np.uint16(Flag.OUTSIDE | Flag.NO_RAY | Flag.MIXED | Flag.CODED)


class UnsteadyNodes:
    """Counts the failures of nodes (rows, cols) from frame to frame."""

    def __init__(self, shape: tuple[int, ...], *, at_rest: bool = False) -> None:
        """at_rest: follow nodes slowly only while the others stay where they are."""
        self._at_rest = at_rest
        self._valid: Mask = np.zeros(shape, np.bool_)
        self._failures: Ints = np.zeros(shape, np.int64)
        self._since_ns: Ints = np.zeros(shape, np.int64)
        self._until_ns: Ints = np.zeros(shape, np.int64)
        self._last_ns = 0

    def learn(self, measured: Warp, known_q: Float) -> Mask | None:
        """Take in a frame; (rows, cols) nodes to be followed slowly, None for none.

        known_q: (rows, cols, 2) LCD px, where nodes were thought to look before it.
        """
        flags, time_ns = measured.flags, measured.time_ns
        valid = flags == 0
        failed = self._valid & ~valid & (flags & _NOT_THE_WINDOW == 0)
        self._valid = valid
        if failed.any():
            late = time_ns - self._since_ns > 1e9 * WITHIN_S
            self._failures[failed & late] = 0
            self._since_ns[failed & (self._failures == 0)] = time_ns
            self._failures[failed] += 1
            again = failed & (self._failures >= FAILURES)
            if again.any():
                self._last_ns = time_ns + round(1e9 * KEPT_S)
                self._until_ns[again] = self._last_ns
        if self._last_ns <= time_ns:
            return None
        unsteady = grown(self._until_ns > time_ns, 1)
        if self._at_rest and quiet_share(measured.q, known_q, flags, unsteady, QUIET_LCD_PX) <= QUIET_SHARE:
            return None
        return unsteady
