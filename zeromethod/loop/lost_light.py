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

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Single
from zeromethod.kernels import kernel, piece, read
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.shading import leaks

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
            _widen_at_edges(residual, self._black, self._period_px)
        else:
            nothing = NOISES2 * (1.0 + 1.0 / self._frames)
            light = _over_rest(residual, self._rest, self._black)
            _widen(light, self._rest, residual.modulation, self._px_per_rad, nothing, residual.sigma)


def _line(values: NDArray[Any], way: int) -> list[NDArray[Any]]:
    """Values before, at, and after the inner nodes, along a row (way 0) or a column (1)."""
    down, across = ([slice(1 + by, size - 1 + by) for by in (-1, 0, 1)] for size in values.shape)
    return [values[one, 1:-1] for one in down] if way else [values[1:-1, one] for one in across]


def _widen_at_edges(residual: Residual, black: float, period_px: float) -> None:
    """Add to sigma, px, what edges of the light at a node, or next to it, may do."""
    valid, sigma, light = residual.valid, residual.sigma, residual.mean.astype(float) - black
    noise2 = NOISES2 * np.where(valid, np.minimum(sigma[..., 0], sigma[..., 1]), 0.0) ** 2
    off2, per_light = np.zeros(valid.shape), BEND_PERIODS * period_px
    for way in range(2):
        (before, now, after), known = _line(light, way), _line(valid, way)
        bend = np.abs(before - 2 * now + after)
        bent = (per_light * bend) ** 2 > noise2[1:-1, 1:-1] * now**2
        j, i = np.nonzero(bent & known[0] & known[1] & known[2])
        r, c = j + 1, i + 1
        left = np.maximum(bend[j, i] - 4 * leaks(residual, period_px, r, c, way), 0.0)
        off2[r, c] = np.maximum(off2[r, c], (per_light * left / now[j, i]) ** 2 - noise2[r, c])
    most2 = cv2.dilate(off2, np.ones((3, 3), np.uint8))
    wide = most2 > 0.0
    sigma[wide] = np.sqrt(sigma[wide] ** 2 + most2[wide, None])


def _over_rest(residual: Residual, rest: Single, black: float) -> Single:
    """Light of nodes over that at rest, (rows, cols) with `_BEYOND` more on each side; 0 where not known."""
    out = np.zeros([size + 2 * _BEYOND for size in rest.shape], np.float32)
    known, inner = residual.valid & (rest > 0), out[_BEYOND:-_BEYOND, _BEYOND:-_BEYOND]
    np.divide(residual.mean - np.float32(black), rest, out=inner, where=known)
    return out


@piece
def _lack(before2: float, before: float, now: float, after: float, after2: float) -> tuple[float, float]:
    """Light that a node lacks, 0 for none, by those on both sides; variance of the difference over its own.

    That of one and of those on a straight line between two, or through two on one side; 0: not known.
    """
    near, further = before + after, after2 if after > 0.0 else before2
    if before > 0.0 and after > 0.0:
        return max(0.5 * near - now, 0.0), 1.5
    return (max(2.0 * near - further - now, 0.0) if near > 0.0 and further > 0.0 else 0.0), 6.0


@kernel(
    read(numba.float32, 2), read(numba.float32, 2), read(numba.float32, 3),
    numba.float64, numba.float64, numba.float64[:, :, ::1],
)  # fmt: skip
def _widen(
    light: Single, rest: Single, modulation: Single, px_per_rad: float, nothing: float, sigma: Float
) -> None:
    """Add to sigma (rows, cols, 2), px, what lost light may do, beyond `nothing` variances of noise.

    The noise of a node's light would by itself move its phase, by that rule, by one sigma. light: as
    `_over_rest` has it.
    """
    by = APART_NODES
    for j in range(by, rest.shape[0] - by):
        for i in range(by, rest.shape[1] - by):
            r, c = j + _BEYOND, i + _BEYOND
            now = light[r, c]
            if not now > 0.0:
                continue
            down, noise_down = _lack(
                light[r - 2 * by, c], light[r - by, c], now, light[r + by, c], light[r + 2 * by, c]
            )
            across, noise_across = _lack(
                light[r, c - 2 * by], light[r, c - by], now, light[r, c + by], light[r, c + 2 * by]
            )
            if down == 0.0 and across == 0.0:
                continue
            lost2 = 2.0 * (px_per_rad * rest[j, i]) ** 2
            for k in range(2):
                amplitude2, own2 = float(modulation[j, i, k]) ** 2, sigma[j, i, k] ** 2
                by_down = lost2 * down**2 - nothing * noise_down * own2 * amplitude2
                by_across = lost2 * across**2 - nothing * noise_across * own2 * amplitude2
                if by_down > 0.0 or by_across > 0.0:
                    sigma[j, i, k] = math.sqrt(own2 + max(by_down, by_across) / amplitude2)
