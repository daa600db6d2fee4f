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

import numba
import numpy as np

from zeromethod.arrays import Bytes, Flags, Float
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

_LIGHT_LOST, _BESIDE_DARK = int(Flag.LIGHT_LOST), int(Flag.BESIDE_DARK)
_NEVER = int(Flag.OUTSIDE | Flag.NO_RAY)


class BesideDark:
    """Remembers, per node, when it came back beside a dark place. shape: (rows, cols) of the nodes."""

    def __init__(self, shape: tuple[int, int], period_px: float) -> None:
        self._left: Bytes = np.zeros(shape, np.uint8)
        self._back: Bytes = np.full(shape, FRAMES + 1, np.uint8)
        self._near: Bytes = np.zeros(shape, np.uint8)
        self._dark_for: Bytes = np.zeros(shape, np.uint8)
        self._dark = False
        self._sigma_px: Float = np.empty((*shape, 2))
        self._edge_px = np.array([0.0, *EDGE_RAD]) * period_px / (2 * math.pi)

    def flag(self, flags: Flags, sigma_px: Float) -> Float:
        """Add BESIDE_DARK to the flags (rows, cols) of nodes that flicker.

        Result: sigma_px (rows, cols, 2) with the error by an edge of the light added, to be used before the
        next call; the same where none is.
        """
        self._dark = _near_dark(flags, self._near)
        if not self._dark:
            if self._left.any():
                _flag(self._left, flags)
            return sigma_px
        _flag(self._left, flags)
        _with_edge(sigma_px, self._near, self._edge_px, self._sigma_px)
        return self._sigma_px

    def learn(self, flags: Flags) -> None:
        """Take in the flags (rows, cols) of the frame that `flag` saw last, with all that was added since."""
        _learn(self._left, self._back, self._dark_for, flags, self._near)


@numba.njit(cache=True)
def _is_within(flags: Flags, j: int, i: int) -> bool:
    """Whether all nodes next to a dark one are dark: what it is near to, one of them is nearer to."""
    lost, both = np.uint16(_LIGHT_LOST), np.uint16(_LIGHT_LOST | _NEVER)
    if not (0 < j < flags.shape[0] - 1 and 0 < i < flags.shape[1] - 1):
        return False
    for b in range(j - 1, j + 2):
        for a in range(i - 1, i + 2):
            if flags[b, a] & both != lost:
                return False
    return True


@numba.njit(cache=True)
def _near_dark(flags: Flags, near: Bytes) -> bool:
    """Nodes to the next dark one in `near`, 1 for itself, 0 beyond `REACH_NODES`; whether there is any."""
    rows, cols = flags.shape
    lost, both = np.uint16(_LIGHT_LOST), np.uint16(_LIGHT_LOST | _NEVER)
    found = False
    near[:] = 0
    for j in range(rows):
        dark = False
        for i in range(cols):
            dark |= flags[j, i] & both == lost
        if not dark:
            continue
        found = True
        for i in range(cols):
            if flags[j, i] & both == lost:
                if _is_within(flags, j, i):
                    near[j, i] = 1
                    continue
                for b in range(max(j - REACH_NODES, 0), min(j + REACH_NODES + 1, rows)):
                    for a in range(max(i - REACH_NODES, 0), min(i + REACH_NODES + 1, cols)):
                        away = max(abs(b - j), abs(a - i)) + 1
                        if near[b, a] == 0 or away < near[b, a]:
                            near[b, a] = away
    return found


@numba.njit(cache=True)
def _lasts(dark_for: Bytes, j: int, i: int) -> bool:
    """Whether a node within `REACH_NODES` has been dark for `STAYS_FRAMES`."""
    rows, cols = dark_for.shape
    for b in range(max(j - REACH_NODES, 0), min(j + REACH_NODES + 1, rows)):
        for a in range(max(i - REACH_NODES, 0), min(i + REACH_NODES + 1, cols)):
            if dark_for[b, a] == STAYS_FRAMES:
                return True
    return False


@numba.njit(cache=True)
def _flag(left: Bytes, flags: Flags) -> None:
    for j in range(flags.shape[0]):
        for i in range(flags.shape[1]):
            if left[j, i] and not flags[j, i] & _LIGHT_LOST:
                flags[j, i] |= _BESIDE_DARK


@numba.njit(cache=True)
def _with_edge(sigma_px: Float, near: Bytes, edge_px: Float, out: Float) -> None:
    out[:] = sigma_px
    for j in range(near.shape[0]):
        for i in range(near.shape[1]):
            if near[j, i] > 1:
                for k in range(2):
                    out[j, i, k] = math.hypot(sigma_px[j, i, k], edge_px[near[j, i] - 1])


@numba.njit(cache=True)
def _pass(left: Bytes, back: Bytes) -> None:
    """One frame more for nodes (n,) that do not fail."""
    for n in range(left.size):
        back[n] = min(back[n] + 1, FRAMES + 1)
        left[n] = max(left[n], 1) - 1


@numba.njit(cache=True)
def _learn(left: Bytes, back: Bytes, dark_for: Bytes, flags: Flags, near: Bytes) -> None:
    """left: frames that a node stays lost. back: frames since it came back, 0 while it fails."""
    lost, both = np.uint16(_LIGHT_LOST), np.uint16(_LIGHT_LOST | _NEVER)
    for j in range(flags.shape[0]):
        for i in range(flags.shape[1]):
            dark_for[j, i] = min(dark_for[j, i] + 1, STAYS_FRAMES) if flags[j, i] & both == lost else 0
    for j in range(flags.shape[0]):
        if near[j].max() == 0:
            _pass(left[j], back[j])
            continue
        for i in range(flags.shape[1]):
            failed = flags[j, i] & ~_BESIDE_DARK and not flags[j, i] & _NEVER
            if failed and near[j, i] and _lasts(dark_for, j, i):
                if left[j, i] or 0 < back[j, i] <= FRAMES:
                    left[j, i] = FRAMES
                back[j, i] = 0
            else:
                _pass(left[j, i : i + 1], back[j, i : i + 1])
