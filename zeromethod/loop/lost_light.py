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

from zeromethod.arrays import Flags, Float, Mask, Single
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
        self._rest, self._light = np.zeros((2, *shape), np.float32)

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
        _open(*seen, self._rest, self._black, self._px_per_rad, nothing, self._light, sigma)
        return replace(residual, sigma=sigma)


@numba.njit(cache=True, error_model="numpy")
def _over_rest(mean: Single, flags: Flags, rest: Single, black: float, out: Single) -> None:
    """Light of nodes over that at rest, (rows, cols); 0 where it is not known."""
    dark, none = np.float32(black), np.float32(0)
    for j in range(mean.shape[0]):
        for i in range(mean.shape[1]):
            known = (flags[j, i] == 0) & (rest[j, i] > none)
            out[j, i] = (mean[j, i] - dark) / rest[j, i] if known else none


@numba.njit(cache=True)
def _expected(light: Single, j: int, i: int, y: int, x: int) -> tuple[float, float]:
    """Light over that at rest by nodes (y, x) away to both sides, and its variance over one's.

    On a straight line between two, or through two on one side; 0 where they are not known.
    """
    rows, cols = light.shape
    before = light[j - y, i - x] if j >= y and i >= x else 0.0
    after = light[j + y, i + x] if j + y < rows and i + x < cols else 0.0
    if before > 0.0 and after > 0.0:
        return 0.5 * (before + after), 0.5
    side = 1 if after > 0.0 else -1
    b, a = j + 2 * side * y, i + 2 * side * x
    further = light[b, a] if 0 <= b < rows and 0 <= a < cols else 0.0
    known = before + after > 0.0 and further > 0.0
    return (2.0 * (before + after) - further, 5.0) if known else (0.0, 0.0)


@numba.njit(cache=True, error_model="numpy")
def _suspects(
    light: Single, rest: Single, modulation: Single, sigma: Float, cut: float, j: int, out: Mask
) -> None:
    """Nodes of a row, away from the lattice's edge, that lack light or have a neighbour without any."""
    by, none, half, times = APART_NODES, np.float32(0), np.float32(0.5), np.float32(cut)
    above, row, below = light[j - by], light[j], light[j + by]
    for i in range(by, light.shape[1] - by):
        down, across = half * (above[i] + below[i]), half * (row[i - by] + row[i + by])
        lack = rest[j, i] * (max(down, across) - row[i])
        noise = min(modulation[j, i, 0] * sigma[j, i, 0], modulation[j, i, 1] * sigma[j, i, 1])
        alone = min(above[i], below[i], row[i - by], row[i + by]) == none
        out[i] = (row[i] > none) & (alone | (lack > times * noise))


@numba.njit(cache=True, error_model="numpy")
def _open(
    mean: Single,
    modulation: Single,
    flags: Flags,
    rest: Single,
    black: float,
    px_per_rad: float,
    nothing: float,
    light: Single,
    sigma: Float,
) -> None:
    """Add to sigma (rows, cols, 2), px, what lost light may do, beyond `nothing` variances of noise.

    The noise of a node's light would by itself move its phase, by that rule, by one sigma. light: work space.
    """
    _over_rest(mean, flags, rest, black, light)
    rows, cols = light.shape
    suspects = np.zeros(cols, np.bool_)
    cut = math.sqrt(0.75 * nothing) / px_per_rad
    for j in range(APART_NODES, rows - APART_NODES):
        _suspects(light, rest, modulation, sigma, cut, j, suspects)
        for i in range(APART_NODES, cols - APART_NODES):
            if not suspects[i]:
                continue
            now = light[j, i]
            down, noise_down = _expected(light, j, i, APART_NODES, 0)
            across, noise_across = _expected(light, j, i, 0, APART_NODES)
            for k in range(2):
                own2 = sigma[j, i, k] ** 2
                per_light2 = 2.0 * (px_per_rad * rest[j, i] / modulation[j, i, k]) ** 2
                by_down = per_light2 * max(down - now, 0.0) ** 2 - nothing * (1.0 + noise_down) * own2
                by_across = per_light2 * max(across - now, 0.0) ** 2 - nothing * (1.0 + noise_across) * own2
                if by_down > 0.0 or by_across > 0.0:
                    sigma[j, i, k] = math.sqrt(own2 + max(by_down, by_across))
