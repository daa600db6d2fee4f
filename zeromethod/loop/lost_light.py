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
import numpy as np

from zeromethod.arrays import Float, Ints, Single
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.shading import LARGEST_STRAIN, STEADY_BEND
from zeromethod.warp.validity import Flag

APART_NODES = 3
"""Way to the nodes that it is held against: windows reach two nodes."""

_BEYOND = 2 * APART_NODES
_OUTSIDE = np.uint16(Flag.OUTSIDE)

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
            _widen(residual, self._rest, self._black, self._px_per_rad, nothing)


def _leak(residual: Residual, period_px: float, r: Ints, c: Ints, way: int) -> Float:
    """`sensing.shading.leak` of nodes (n,) that are measured with their neighbours along a row or column."""
    modulation, d, flags = residual.modulation.astype(float), residual.d, residual.flags
    y, x = way, 1 - way
    steps = np.stack([d[r - y, c - x], d[r + y, c + x]]) - d[r, c]
    steps -= period_px * np.rint(steps / period_px)
    largest = np.abs(steps).max(axis=0)
    before, after = steps[:, :, way]
    first, last = (flags[r + far * y, c + far * x] & _OUTSIDE != 0 for far in (-2, 2))
    other = modulation[..., x]
    bend = np.abs(other[r - y, c - x] - 2 * other[r, c] + other[r + y, c + x])
    beyond = (first | last) & (bend < STEADY_BEND * other[r, c])
    straight = np.abs(np.where(last, 3 * after + 2 * before, 3 * before + 2 * after))
    np.maximum(largest[:, way], straight, out=largest[:, way], where=beyond)
    strain = np.minimum(largest / (period_px / 2), LARGEST_STRAIN)
    leaked: Float = (modulation[r, c] * strain**2).sum(axis=-1)
    return leaked


def _widen_at_edges(residual: Residual, black: float, period_px: float) -> None:
    """Add to sigma, px, what edges of the light at a node, or next to it, may do."""
    good, sigma, (rows, cols) = residual.valid, residual.sigma, residual.mean.shape
    light = residual.mean.astype(float) - black
    noise2 = NOISES2 * np.minimum(sigma[..., 0], sigma[..., 1]) ** 2
    off2 = np.zeros((rows, cols))
    for way in range(2):
        (before, now, after), known = (
            [
                one[1 + n * way : rows - 1 + n * way, 1 + n * (1 - way) : cols - 1 + n * (1 - way)]
                for n in (-1, 0, 1)
            ]
            for one in (light, good)
        )
        bend = BEND_PERIODS * period_px * np.abs(before - 2 * now + after)
        bent = bend**2 > noise2[1:-1, 1:-1] * now**2
        j, i = np.nonzero(bent & known[0] & known[1] & known[2])
        r, c = j + 1, i + 1
        leaked = BEND_PERIODS * period_px * 4 * _leak(residual, period_px, r, c, way)
        by = np.maximum(bend[j, i] - leaked, 0.0) / now[j, i]
        off2[r, c] = np.maximum(off2[r, c], by**2 - noise2[r, c])
    most2 = cv2.dilate(off2, np.ones((3, 3), np.uint8))
    wide = most2 > 0.0
    sigma[wide] = np.sqrt(sigma[wide] ** 2 + most2[wide, None])


def _over_rest(residual: Residual, rest: Single, black: float) -> Single:
    """Light of nodes over that at rest, (rows, cols) with `_BEYOND` more on each side; 0 where not known."""
    out = np.zeros([size + 2 * _BEYOND for size in rest.shape], np.float32)
    known, inner = residual.valid & (rest > 0), out[_BEYOND:-_BEYOND, _BEYOND:-_BEYOND]
    np.divide(residual.mean - np.float32(black), rest, out=inner, where=known)
    return out


def _lacks(seen: list[Any]) -> tuple[Any, Any]:
    """Light that nodes lack by those on both sides, 0 for none; whether it is known on both.

    seen: light of the two before them, of themselves, and of the two after, as arrays of one shape. By those
    on a straight line between two, or through two on one side; 0 where they are not known.
    """
    before2, before, now, after, after2 = seen
    both = (before > 0) & (after > 0)
    near, further = before + after, np.where(after > 0, after2, before2)
    onward = np.where((near > 0) & (further > 0), 2 * near - further, 0)
    return np.maximum(np.where(both, near / 2, onward) - now, 0), both


def _widen(residual: Residual, rest: Single, black: float, px_per_rad: float, nothing: float) -> None:
    """Add to sigma (rows, cols, 2), px, what lost light may do, beyond `nothing` variances of noise.

    The noise of a node's light would by itself move its phase, by that rule, by one sigma. Single precision
    finds the few nodes that may lack light; they are worked out in double.
    """
    light, sigma, by = _over_rest(residual, rest, black), residual.sigma, APART_NODES
    rows, cols = light.shape
    far = np.arange(-2, 3) * by
    at = _BEYOND + by
    height, width = rows - 2 * at, cols - 2 * at
    down = _lacks([light[at + to : at + to + height, at : at + width] for to in far])[0]
    across = _lacks([light[at : at + height, at + to : at + to + width] for to in far])[0]
    noise = residual.modulation * sigma.astype(np.float32)
    least = np.minimum(noise[..., 0], noise[..., 1])
    cut = 0.99 * math.sqrt(0.75 * nothing) / px_per_rad  # but for rounding what is added below, or less
    here = slice(by, -by), slice(by, -by)
    may = (np.maximum(down, across) * rest[here] > np.float32(cut) * least[here]) & (rest[here] > 0)
    j, i = (found + by for found in np.nonzero(may & residual.valid[here]))
    own2 = sigma[j, i] ** 2
    per_light2 = 2.0 * (px_per_rad * rest[j, i, None] / residual.modulation[j, i]) ** 2
    more = np.zeros_like(own2)
    for along in (far[:, None], 0), (0, far[:, None]):
        seen = light[j + _BEYOND + along[0], i + _BEYOND + along[1]].astype(float)
        lack, both = _lacks(seen)
        variance = np.where(both, 1.5, 6.0)
        more = np.maximum(more, per_light2 * lack[:, None] ** 2 - nothing * variance[:, None] * own2)
    sigma[j, i] = np.sqrt(own2 + more)
