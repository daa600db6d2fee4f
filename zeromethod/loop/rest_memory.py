"""Whether the mirror is at rest, by the rest map and by what was off when it was first at rest.

Dirt moves nodes for good, by as much as a small press does, and nothing in one frame distinguishes them. So
the first rest may have dirt on it: a quarter of the nodes of a block do not count. What is off then is
remembered, and from then on the mirror is at rest only where it is as it was: no small press that comes later
passes for dirt.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import maximum_filter

from zeromethod.arrays import Float, Mask
from zeromethod.loop.node_figures import at_rest, block_sums
from zeromethod.warp.components import blank, squared_length, twice
from zeromethod.warp.warp import Warp

REST_BLOCK = 4
"""Half of the nodes on a side of the blocks that must all be at rest for the mirror to be."""

REST_SIGMAS, REST_WITHIN_LCD_PX = 3.0, 0.05
"""A block is at rest up to this rms displacement beyond this many deviations of noise: 0.2 µm of press."""

FRAMES = 16
"""Frames at rest whose mean is remembered; until there are as many, the mean of fewer."""

PART = 4
"""Side, in nodes, of the parts that are compared with what is remembered: nothing disturbs a smaller part, as
a sensing window covers more than a node."""

WITHIN_LCD_PX = 0.02
"""A node is as it was up to this displacement beyond noise, drift of the whole view taken off: 0.08 µm of
press. A part is judged by the rms and twice the mean of its nodes' displacements, each over its own limit."""

SIGMAS = 4.0
"""Deviations of noise that are added to that limit: some thousand parts are judged a second."""

OPEN = 0.3
"""Share of the displacement at rest that is added, too: under drifting light dirt displaces nodes
otherwise."""

LEAST_NODES = 8
"""Nodes of a part that must be known for it to be judged."""


def quadratic(x: Float, y: Float) -> Float:
    """Terms (..., 6) up to second order of places x, y (...) of size 1: drift is smooth over the view."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def is_at_rest(q: Float, rest_q: Float, sigma: Float, valid: Mask) -> bool:
    """Whether a warp q (rows, cols, 2), LCD px, of this sigma differs from rest by noise and dirt alone."""
    return bool(at_rest(q, rest_q, sigma, valid, REST_BLOCK, REST_SIGMAS, REST_WITHIN_LCD_PX))


class RestMemory:
    """What was off at the first rest, LCD px from the warp of the untouched mirror; shape: of the nodes."""

    def __init__(self, shape: tuple[int, int]) -> None:
        rows, cols = (np.arange(-(-size // PART)) * (PART / size) - 0.5 for size in shape)
        self._terms = quadratic(*np.meshgrid(cols, rows))
        self._frames = 0
        self._known: Mask = np.ones(shape, np.bool_)
        self._open: Float = np.zeros((*shape, 2))
        self.off: Float = np.zeros((*shape, 2))
        """(rows, cols, 2) LCD px that nodes are off at rest; 0 where that is not known."""

    def restart(self) -> None:
        """All nodes are where rest is said to be now."""
        self._frames, self._known = FRAMES, np.ones_like(self._known)
        self.off, self._open = np.zeros_like(self.off), np.zeros_like(self._open)

    def at_rest(self, estimate: Float, measured: Warp, rest_q: Float) -> bool:
        """Whether the mirror is untouched.

        estimate: (rows, cols, 2) warp by the controller, which has less noise than the one measured. rest_q:
        that of the untouched mirror. LCD px.
        """
        known = measured.sigma, measured.valid
        if not is_at_rest(estimate, rest_q, *known):
            return False
        return self.pressed_lcd_px(measured.q - rest_q, *known) == 0.0

    def learn(self, measured: Warp, rest_q: Float) -> None:
        """Take in a frame of the mirror at rest."""
        if self._frames < FRAMES:
            self._frames += 1
            self._known &= measured.valid
            self.off += (measured.q - rest_q - self.off) / self._frames
            self.off[~self._known] = 0.0
            self._open[:] = OPEN * maximum_filter(np.abs(self.off).max(axis=-1), 3)[..., None]

    def pressed_lcd_px(self, away: Float, sigma: Float, valid: Mask) -> float:
        """Displacement rms of the part that is most unlike it was at rest; 0 where all are within limits.

        away: (rows, cols, 2) displacement from the warp of the untouched mirror; sigma: of its noise. LCD px.
        """
        if self._frames == 0:
            return 0.0
        known = valid & self._known
        limit = WITHIN_LCD_PX + SIGMAS * math.sqrt(1.0 + 1.0 / self._frames) * sigma
        pressed = self._unlike(away, limit, known)
        if pressed > 0.0:
            pressed = self._unlike(away - self._drift(away, known), limit, known)
        return pressed

    def _drift(self, away: Float, known: Mask) -> Float:
        """Change (rows, cols, 2) since rest that is smooth over the view."""
        now = away - self.off
        blank(now, ~known, 0.0)
        nodes = block_sums(known.astype(float), PART, PART)
        enough = nodes >= LEAST_NODES
        terms, mean = self._terms[enough], block_sums(now, PART, PART)[enough] / nodes[enough, None]
        drift: Float = self._terms @ np.linalg.lstsq(terms, mean, rcond=None)[0]
        rows, cols = known.shape
        return drift.repeat(PART, axis=0)[:rows].repeat(PART, axis=1)[:, :cols]

    def _unlike(self, away: Float, limit: Float, known: Mask) -> float:
        """Largest rms of a part that is neither as it was nor where the untouched mirror is, LCD px."""
        now, as_it_was, untouched = away - self.off, limit + self._open, away / limit
        np.divide(now, as_it_was, out=as_it_was)
        unknown = twice(~known)
        for values in (now, as_it_was, untouched):
            np.copyto(values, 0.0, where=unknown)
        nodes = block_sums(known.astype(float), PART, PART)
        # as it was, or as the untouched mirror is: something may have lifted since
        unlike = (nodes >= LEAST_NODES) & ~(_within(as_it_was, nodes) | _within(untouched, nodes))
        squares = block_sums(0.5 * squared_length(now), PART, PART)[unlike] / nodes[unlike]
        return math.sqrt(squares.max(initial=0.0))


def _within(over: Float, nodes: Float) -> Mask:
    """Whether parts are within their limits: displacements (rows, cols, 2) over these, 0 where not known."""
    square = block_sums(0.5 * squared_length(over), PART, PART)
    sums = np.abs(block_sums(over, PART, PART))
    return np.asarray((square <= nodes) & (np.maximum(sums[..., 0], sums[..., 1]) <= 0.5 * nodes))
