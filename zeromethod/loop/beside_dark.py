"""Nodes beside a dark place: flickering ones count as lost for some frames, all of them get a larger sigma.

Beside a contact a node's light crosses the limit with the noise. Each time it does, a phase falsified by the
contact's edge comes or goes, and the picture around changes: without memory the command never settles there.
A node that fails only once counts again at once, and so does one beside a place that went dark just now:
while a sudden press is nulled, light goes and comes back everywhere, and the loop needs each node that sees
any.

An edge of the light t nodes away leaves (1 - t/2)^2 / 2 of the triangular window dark, which moves the phase
by up to as many radians; nearer edges than about one node are found by the light itself (`sensing.shading`).
"""

from __future__ import annotations

import math

import numpy as np

from zeromethod.arrays import Bytes, Flags, Float, Mask
from zeromethod.loop.failing_nodes import grown
from zeromethod.warp.components import twice
from zeromethod.warp.validity import Flag

FRAMES = 8
"""Frames within which a node that came back and fails again flickers; it counts after as many good ones."""

STAYS_FRAMES = 30
"""A place that has been dark for so long is a contact's; a sudden press is nulled sooner."""

REACH_NODES = 2
"""How far from a dark node others flicker with it."""

EDGE_RAD = 0.07, 0.015
"""Rms phase error, rad, of nodes next to a dark one and one further: edges 1 to 1.5 and 1.5 to 2 nodes away,
any phase of the picture there."""

_LIGHT_LOST, _BESIDE_DARK = np.uint16(Flag.LIGHT_LOST), np.uint16(Flag.BESIDE_DARK)
_NEVER = np.uint16(Flag.OUTSIDE | Flag.NO_RAY)


class BesideDark:
    """Remembers, per node, when it came back beside a dark place. shape: (rows, cols) of the nodes."""

    def __init__(self, shape: tuple[int, int], period_px: float) -> None:
        self._left: Bytes = np.zeros(shape, np.uint8)  # frames that a node stays lost
        self._back: Bytes = np.full(shape, FRAMES + 1, np.uint8)  # since it came back, 0 while it fails
        self._near: Bytes = np.zeros(shape, np.uint8)
        self._dark_for: Bytes = np.zeros(shape, np.uint8)
        self._edge_px2 = (np.array([0.0, 0.0, *EDGE_RAD]) * period_px / (2 * math.pi)) ** 2

    def flag(self, flags: Flags, sigma_px: Float) -> Float:
        """Add BESIDE_DARK to the flags (rows, cols) of nodes that flicker.

        Result: sigma_px (rows, cols, 2) with the error by an edge of the light added; the same where none is.
        """
        if self._left.any():
            flags[(self._left > 0) & (flags & _LIGHT_LOST == 0)] |= _BESIDE_DARK
        dark = _dark(flags)
        if not dark.any():
            self._near[:] = 0
            return sigma_px
        self._near = _near(dark)
        wider: Float = np.sqrt(sigma_px**2 + twice(self._edge_px2[self._near]))
        return wider

    def learn(self, flags: Flags) -> None:
        """Take in the flags (rows, cols) of the frame that `flag` saw last, with all that was added since."""
        self._dark_for = np.minimum(self._dark_for + 1, STAYS_FRAMES) * _dark(flags)
        failed = (flags & ~_BESIDE_DARK != 0) & (flags & _NEVER == 0) & (self._near > 0)
        before, back = self._left > 0, self._back
        self._left -= before
        self._back = np.minimum(back + 1, FRAMES + 1)
        if failed.any():
            failed &= grown(self._dark_for == STAYS_FRAMES, REACH_NODES)
            self._left[failed & (before | ((back > 0) & (back <= FRAMES)))] = FRAMES
            self._back[failed] = 0


def _dark(flags: Flags) -> Mask:
    """Nodes (rows, cols) without light, of those that could see any."""
    return np.asarray(flags & (_LIGHT_LOST | _NEVER) == _LIGHT_LOST)


def _near(marked: Mask) -> Bytes:
    """Nodes (rows, cols) to the next marked one, 1 for itself, 0 beyond `REACH_NODES`."""
    near = np.zeros(marked.shape, np.uint8)
    for by in reversed(range(REACH_NODES + 1)):
        near[grown(marked, by)] = by + 1
    return near
