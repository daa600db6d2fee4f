"""Light that nodes have lost since rest: a contact smaller than a node's window falsifies what it sees.

A contact takes the light of some pixels of a node's window, and with it what they added to the carrier. A
share f of the light, lost in one place, takes f of the mean times a phase by chance from an amplitude of
A / 2: the node's phase is off by f sqrt(2) mean / A, rms. Where the light is gone altogether nodes are
flagged (`sensing.shading`); here is what a few percent do, which no rule about edges shows.

Light may also change smoothly, by a backlight that drifts or a mirror that tilts. So it is held against that
of nodes to both sides whose windows do not share the contact.

Until the mirror was at rest, an edge of the light counts in another way, too: of dirt, or of a lamp's image
whose displacements are known from the rest on (`session.dirt`). The mean bends there from node to
node, as `sensing.shading` says.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.shading import leak

APART_NODES = 3
"""Way to the nodes that it is held against: windows reach two nodes."""

_BEYOND = 2 * APART_NODES

FRAMES = 16
"""Frames at rest whose mean light is the light at rest."""

BEND_PERIODS = 0.31
"""Phase error, periods, per bend of the mean over the mean: a bend is a quarter of a step, which moves the
phase by up to 2.5 px of 16 times its share of the light: half of that."""

NOISES2 = 9.0
"""Square of the deviations, in standard deviations of noise, that may be noise alone."""


class LostLight:
    """Widens the sigma of residuals by what lost light may do; before rest is known, by what edges may."""

    def __init__(self, shape: tuple[int, int], period_px: float, black_grey: float) -> None:
        self._period_px, self._px_per_rad = period_px, period_px / (2 * math.pi)
        self._black = black_grey
        self._frames = 0
        self._rest = np.zeros(shape, np.float32)
        self._light = np.zeros([n + 2 * _BEYOND for n in shape], np.float32)
        self._lack = np.zeros((shape[0], shape[1] + 2 * _BEYOND), np.float32)

    def learn(self, residual: Residual) -> None:
        """Take in the light of a residual at rest; 0 where a node was not measured."""
        if self._frames < FRAMES:
            self._frames += 1
            light = np.maximum(residual.mean - np.float32(self._black), np.float32(0))
            known = residual.valid & ((self._rest > 0) | (self._frames == 1))
            self._rest = np.where(known, self._rest + (light - self._rest) / self._frames, np.float32(0))

    def widen_sigma(self, residual: Residual) -> None:
        """Add to the sigma of a residual, in place, what light lost at each node may do to its phase."""
        if self._frames == 0:
            _widen_at_edges(residual.arrays, self._black, self._period_px)
            return
        seen = residual.mean, residual.modulation, residual.flags
        nothing = NOISES2 * (1.0 + 1.0 / self._frames)
        _widen(
            *seen, self._rest, self._black, self._px_per_rad, nothing, self._light, self._lack, residual.sigma
        )


@numba.njit(cache=True, error_model="numpy")
def _bent(seen: tuple[Float, Float, Flags, Single, Single], period_px: float, j: int, i: int) -> float:
    """Larger second difference of the mean at a node, grey levels, less what strain leaks into it."""
    d, _, flags, modulation, mean = seen
    most = 0.0
    for way in range(2):
        y, x = way, 1 - way
        if flags[j - y, i - x] == 0 and flags[j + y, i + x] == 0:
            bend = abs(float(mean[j - y, i - x] - 2 * mean[j, i] + mean[j + y, i + x]))
            if bend > most:
                most = max(most, bend - 4 * leak(modulation, d, flags, period_px, j, i, way))
    return most


@numba.njit(cache=True, error_model="numpy")
def _widen_at_edges(seen: tuple[Float, Float, Flags, Single, Single], black: float, period_px: float) -> None:
    """Add to sigma, px, what edges of the light at a node, or next to it, may do; seen: `Residual.arrays`."""
    _, sigma, flags, _, mean = seen
    rows, cols = mean.shape
    off2 = np.zeros((rows, cols))
    for j in range(1, rows - 1):
        for i in range(1, cols - 1):
            if flags[j, i] == 0:
                by = BEND_PERIODS * period_px * _bent(seen, period_px, j, i) / (mean[j, i] - black)
                off2[j, i] = max(by**2 - NOISES2 * min(sigma[j, i, 0], sigma[j, i, 1]) ** 2, 0.0)
    for j in range(1, rows - 1):
        for i in range(1, cols - 1):
            most2 = off2[j - 1 : j + 2, i - 1 : i + 2].max()
            if most2 > 0.0:
                for k in range(2):
                    sigma[j, i, k] = math.sqrt(sigma[j, i, k] ** 2 + most2)


@numba.njit(cache=True, error_model="numpy")
def _over_rest(mean: Single, flags: Flags, rest: Single, black: float, out: Single) -> None:
    """Light of nodes over that at rest, (rows, cols) with `_BEYOND` more on each side; 0 where not known."""
    dark, none = np.float32(black), np.float32(0)
    for j in range(mean.shape[0]):
        to = out[j + _BEYOND, _BEYOND:]
        for i in range(mean.shape[1]):
            known = (flags[j, i] == 0) & (rest[j, i] > none)
            to[i] = (mean[j, i] - dark) / rest[j, i] if known else none


@numba.njit(cache=True, error_model="numpy", inline="always")
def _straight_on(before2: Any, before: Any, after: Any, after2: Any, zero: Any, half: Any, two: Any) -> Any:
    """Light between two nodes, or two on one side, on a straight line; 0 where they are not known."""
    near, further = before + after, after2 if after > zero else before2
    onward = two * near - further if (near > zero) & (further > zero) else zero
    return half * near if (before > zero) & (after > zero) else onward


@numba.njit(cache=True)
def _lacks(light: Single, way: int, out: Single) -> None:
    """Light over that at rest that nodes lack by those `way` to both sides, in `out` if more than is there.

    light, out: flat, `_BEYOND` rows and columns more on each side of `light`, columns alone of `out`.
    """
    zero, half, two, count = np.float32(0), np.float32(0.5), np.float32(2), out.size
    first = (light.size - count) // 2
    now, before2, after2 = light[first:], light[first - 2 * way :], light[first + 2 * way :]
    before, after = light[first - way :], light[first + way :]
    for i in range(count):
        straight = _straight_on(before2[i], before[i], after[i], after2[i], zero, half, two)
        out[i] = max(straight - now[i], out[i])


@numba.njit(cache=True)
def _suspects(lack: Single, rest: Single, modulation: Single, sigma: Float, cut: float, out: Mask) -> None:
    """Nodes (n,) that lack `cut` times the noise of their light: of the carrier with less of it.

    modulation, sigma: (2 n,) of both carriers in turn, as lines for the compiler to vectorise.
    """
    times = np.float32(cut)
    for i in range(rest.size):
        first = modulation[2 * i] * np.float32(sigma[2 * i])
        second = modulation[2 * i + 1] * np.float32(sigma[2 * i + 1])
        out[i] = lack[i] * rest[i] > times * min(first, second)


@numba.njit(cache=True, error_model="numpy")
def _by(light: Single, j: int, i: int, down: int, across: int) -> tuple[float, float]:
    """Light that a node lacks, 0 for none, by those on both sides; variance of the difference over its own.

    That of one and of those on a straight line between two, or through two on one side.
    """
    before, after = light[j - down, i - across], light[j + down, i + across]
    before2, after2 = light[j - 2 * down, i - 2 * across], light[j + 2 * down, i + 2 * across]
    straight = _straight_on(before2, before, after, after2, 0.0, 0.5, 2.0)
    return max(straight - light[j, i], 0.0), 1.5 if (before > 0.0) & (after > 0.0) else 6.0


@numba.njit(cache=True, error_model="numpy")
def _widen(
    mean: Single,
    modulation: Single,
    flags: Flags,
    rest: Single,
    black: float,
    px_per_rad: float,
    nothing: float,
    light: Single,
    lack: Single,
    sigma: Float,
) -> None:
    """Add to sigma (rows, cols, 2), px, what lost light may do, beyond `nothing` variances of noise.

    The noise of a node's light would by itself move its phase, by that rule, by one sigma. light, lack: work
    space. Single precision finds the few nodes that may lack light; they are worked out in double.
    """
    _over_rest(mean, flags, rest, black, light)
    rows, cols = mean.shape
    by, at = APART_NODES, _BEYOND
    lack[:] = 0.0
    flat_light, flat_lack = light.reshape(light.size), lack.reshape(lack.size)
    _lacks(flat_light, by * light.shape[1], flat_lack)
    _lacks(flat_light, by, flat_lack)
    suspects = np.zeros(8 * ((cols + 7) // 8), np.bool_)
    eights = suspects.view(np.uint64)
    cut = 0.99 * math.sqrt(0.75 * nothing) / px_per_rad  # but for rounding what is added below, or less
    for j in range(by, rows - by):
        both, errors = modulation[j].reshape(2 * cols), sigma[j].reshape(2 * cols)
        _suspects(lack[j, at:], rest[j], both, errors, cut, suspects)
        for eight in range(eights.size):
            if eights[eight] == 0:
                continue
            for i in range(max(8 * eight, by), min(8 * eight + 8, cols - by)):
                now = light[at + j, at + i]
                if not (suspects[i] and now > 0.0):
                    continue
                down, noise_down = _by(light, at + j, at + i, by, 0)
                across, noise_across = _by(light, at + j, at + i, 0, by)
                for k in range(2):
                    own2 = sigma[j, i, k] ** 2
                    per_light2 = 2.0 * (px_per_rad * rest[j, i] / modulation[j, i, k]) ** 2
                    by_down = per_light2 * down**2 - nothing * noise_down * own2
                    by_across = per_light2 * across**2 - nothing * noise_across * own2
                    if by_down > 0.0 or by_across > 0.0:
                        sigma[j, i, k] = math.sqrt(own2 + max(by_down, by_across))
