"""Light that nodes have lost since rest: a contact smaller than a node's window falsifies what it sees.

A contact takes the light of some pixels of a node's window, and with it what they added to the carrier. A
share f of the light, lost in one place, takes f of the mean times a phase by chance from an amplitude of
A / 2: the node's phase is off by f sqrt(2) mean / A, rms. Where the light is gone altogether nodes are
flagged (`sensing.shading`); here is what a few percent do, which no rule about edges shows.

Light may also change smoothly, by a backlight that drifts or a mirror that tilts. So it is held against that
of nodes to both sides whose windows do not share the contact.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Single
from zeromethod.sensing.residual import Residual

APART_NODES = 3
"""Way to the nodes that it is held against: windows reach two nodes."""

FRAMES = 16
"""Frames at rest whose mean light is the light at rest."""

NOISES2 = 9.0
"""Square of the deviations of noise that say nothing."""


class LostLight:
    """Adds what lost light may do to the sigma of residuals; nothing until it knows the light at rest."""

    def __init__(self, shape: tuple[int, int], period_px: float, black_grey: float) -> None:
        self._px_per_rad = period_px / (2 * math.pi)
        self._black = black_grey
        self._frames = 0
        self._rest = np.zeros(shape, np.float32)

    def learn(self, residual: Residual) -> None:
        """Take in the light of a residual at rest; 0 where a node was not measured."""
        if self._frames < FRAMES:
            self._frames += 1
            light = np.maximum(residual.mean - np.float32(self._black), np.float32(0))
            known = residual.valid & ((self._rest > 0) | (self._frames == 1))
            self._rest = np.where(known, self._rest + (light - self._rest) / self._frames, np.float32(0))

    def opened(self, residual: Residual) -> Residual:
        """The residual with that in its sigma."""
        sigma = residual.sigma.copy()
        seen = residual.mean, residual.modulation, residual.flags
        nothing = NOISES2 * (1.0 + 1.0 / max(self._frames, 1))
        _open(*seen, self._rest, self._black, self._px_per_rad, nothing, sigma)
        return replace(residual, sigma=sigma)


@numba.njit(cache=True)
def _light(mean: Single, flags: Flags, rest: Single, black: float, j: int, i: int) -> float:
    """Light of a node over that at rest; 0 where it is not known."""
    inside = 0 <= j < mean.shape[0] and 0 <= i < mean.shape[1]
    if not inside or flags[j, i] != 0 or rest[j, i] <= 0.0:
        return 0.0
    return float(max((mean[j, i] - black) / rest[j, i], 0.0))


@numba.njit(cache=True)
def _expected(
    mean: Single, flags: Flags, rest: Single, black: float, j: int, i: int, y: int, x: int
) -> tuple[float, float]:
    """Light over that at rest by nodes `APART_NODES` away along (y, x), and its variance over one's.

    On a straight line between two, or through two on one side; 0 where they are not known.
    """
    y, x = APART_NODES * y, APART_NODES * x
    before = _light(mean, flags, rest, black, j - y, i - x)
    after = _light(mean, flags, rest, black, j + y, i + x)
    if before > 0.0 and after > 0.0:
        return 0.5 * (before + after), 0.5
    side = 1 if after > 0.0 else -1
    further = _light(mean, flags, rest, black, j + 2 * side * y, i + 2 * side * x)
    return (2.0 * max(before, after) - further, 5.0) if before + after > 0.0 and further > 0.0 else (0.0, 0.0)


@numba.njit(cache=True)
def _open(
    mean: Single,
    modulation: Single,
    flags: Flags,
    rest: Single,
    black: float,
    px_per_rad: float,
    nothing: float,
    sigma: Float,
) -> None:
    """Add to sigma (rows, cols, 2), px, what lost light may do, beyond `nothing` variances of noise.

    The noise of a node's light would by itself move its phase, by that rule, by one sigma.
    """
    for j in range(mean.shape[0]):
        for i in range(mean.shape[1]):
            now = _light(mean, flags, rest, black, j, i)
            if now > 0.0:
                down = _expected(mean, flags, rest, black, j, i, 1, 0)
                across = _expected(mean, flags, rest, black, j, i, 0, 1)
                for k in range(2):
                    off, more = px_per_rad * (mean[j, i] - black) / max(modulation[j, i, k], 1e-6), 0.0
                    for expected, noise in (down, across):
                        if expected > now:
                            off2 = 2.0 * (off * (1.0 - now / expected)) ** 2
                            more = max(more, off2 - nothing * (1.0 + noise) * sigma[j, i, k] ** 2)
                    sigma[j, i, k] = math.sqrt(sigma[j, i, k] ** 2 + more)
