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

_BEYOND = 2 * APART_NODES

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
        self._light = np.zeros([n + 2 * _BEYOND for n in shape], np.float32)

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
    """Light of nodes over that at rest, (rows, cols) with `_BEYOND` more on each side; 0 where not known."""
    dark, none = np.float32(black), np.float32(0)
    for j in range(mean.shape[0]):
        to = out[j + _BEYOND, _BEYOND:]
        for i in range(mean.shape[1]):
            known = (flags[j, i] == 0) & (rest[j, i] > none)
            to[i] = (mean[j, i] - dark) / rest[j, i] if known else none


@numba.njit(cache=True)
def _lacking(before2: Single, before: Single, now: Single, after: Single, after2: Single, out: Float) -> None:
    """Light over that at rest that nodes lack (0, n), by nodes to both sides, and its variance over one's.

    That of one and of those on a straight line between two, or through two on one side; 0 where they are not
    known. Arguments: of the nodes there, (n,) each, 0 where not known; lines, for the compiler to vectorise.
    """
    lack, variance = out[0], out[1]
    for i in range(lack.size):
        b, a = float(before[i]), float(after[i])
        both, near, further = (b > 0.0) & (a > 0.0), b + a, after2[i] if a > 0.0 else before2[i]
        onward = 2.0 * near - further if (near > 0.0) & (further > 0.0) else 0.0
        lack[i] = max((0.5 * near if both else onward) - now[i], 0.0)
        variance[i] = 1.5 if both else 6.0


@numba.njit(cache=True)
def _noise2(modulation: Single, sigma: Float, cut2: float, out: Float) -> None:
    """Variance of the light of nodes (n,), so many times: of the carrier with less noise."""
    for i in range(out.size):
        out[i] = cut2 * min(modulation[i, 0] * sigma[i, 0], modulation[i, 1] * sigma[i, 1]) ** 2


@numba.njit(cache=True, error_model="numpy")
def _suspects(now: Single, rest: Single, down: Float, across: Float, noise2: Float, out: Mask) -> None:
    """Nodes (n,) that lack more light than noise takes. down, across: as `_lacking` has them."""
    lack_down, noise_down, lack_across, noise_across = down[0], down[1], across[0], across[1]
    for i in range(out.size):
        lack2 = max(lack_down[i] ** 2 / noise_down[i], lack_across[i] ** 2 / noise_across[i])
        out[i] = (now[i] > 0.0) & (rest[i] * rest[i] * lack2 > noise2[i])


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
    rows, cols = mean.shape
    down, across = np.empty((2, cols)), np.empty((2, cols))
    noise2, suspects = np.empty(cols), np.empty(cols, np.bool_)
    by, at = APART_NODES, _BEYOND
    cut2 = 0.499 * nothing / px_per_rad**2  # but for rounding what is added below
    for j in range(by, rows - by):
        row, above, below = light[at + j], light[at + j - by], light[at + j + by]
        now = row[at:]
        _lacking(light[j, at:], above[at:], now, below[at:], light[j + 2 * at, at:], down)
        _lacking(row, row[at - by :], now, row[at + by :], row[2 * at :], across)
        _noise2(modulation[j], sigma[j], cut2, noise2)
        _suspects(now, rest[j], down, across, noise2, suspects)
        for i in range(by, cols - by):
            if not suspects[i]:
                continue
            for k in range(2):
                own2 = sigma[j, i, k] ** 2
                per_light2 = 2.0 * (px_per_rad * rest[j, i] / modulation[j, i, k]) ** 2
                by_down = per_light2 * down[0, i] ** 2 - nothing * down[1, i] * own2
                by_across = per_light2 * across[0, i] ** 2 - nothing * across[1, i] * own2
                if by_down > 0.0 or by_across > 0.0:
                    sigma[j, i, k] = math.sqrt(own2 + max(by_down, by_across))
