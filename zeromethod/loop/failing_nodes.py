"""Nodes that no picture nulls, though they see the LCD: those that coded pictures can read.

Not what something touches, nor what has dirt or the edge of a shadow before it, nor what looks past the LCD:
coded pictures would show nothing there either.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Flags, Float, Mask, Single
from zeromethod.sensing.residual import Residual
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

FAILING_FRAMES, MOST_FRAMES = 2, 12
"""A failure is remembered for this many frames; repeated failures of one node for up to this many."""

LASTING_FRAMES = 4
"""Remembered failure, in frames, that makes it lasting: a node fails in more than a third of the frames. What
fails less often is read by the carrier."""

DIRTY_FRAMES = 4
"""A node that failed in this many frames where the mirror is flat is dirty, and never read by coded
pictures."""

BENT_LCD_PX = 2.0
"""Difference of where nodes near each other look, from rest, below which the mirror is too flat to fold.
A fold displaces each node by as much as its distance from the next, some 8 LCD px; dirt by less than half a
one."""

EDGE_NODES = 2
"""A node this close to one that is dark at rest may fail when a press moves the edge of the light."""

LIT_SHARE = 0.3
"""Mean light over that at rest above which a node sees the LCD at all."""

BRIGHTER = 1.02
"""Nodes behind a lamp's image gained this much more light since rest than others; nodes of a fold did not."""

REACH_NODES = 3
"""Failing nodes this close to each other make one patch."""

FURTHER = 3
"""How often a patch that touches no known node is enlarged: an edge of the light disturbs five columns."""

SEAM_NODES = 6
"""Width, in nodes, by which a saw's seam may grow where the mirror slopes."""

GROWS_SHARE = 0.1
"""If more than this share of the failing nodes failed for the first time, more are going to."""

CANNOT = np.uint16(Flag.MODULATION | Flag.LIGHT_LOST | Flag.FOLDED | Flag.UNDRAWABLE | Flag.AMBIGUOUS)
"""Flags of nodes that cannot be nulled."""

_FOR_NOW, _LIGHT_LOST = np.uint16(Flag.MIXED | Flag.CODED), np.uint16(Flag.LIGHT_LOST)
_OFF_DISPLAY = np.uint16(Flag.OFF_DISPLAY)
_FAR = np.float32(1e6)


class FailingNodes:
    """Remembers which nodes fail while the mirror is at rest.

    need: (rows, cols) nodes that failed in one of the last frames. grows: whether many of them were new.
    """

    def __init__(self, rest: Rest, black_grey: float) -> None:
        self.need: Mask = np.zeros_like(rest.visible)
        self.grows = False
        self._rest, self._black = rest, black_grey
        self._light: Single | None = None
        self._left: Bytes = np.zeros(rest.q.shape[:2], np.uint8)
        self._flat: Bytes = np.zeros(rest.q.shape[:2], np.uint8)
        # what a slope makes dark at a seam, no coded picture reads
        self._seams: Mask = grown(rest.flags & np.uint16(Flag.SEAM) != 0, SEAM_NODES)
        self._never: Mask = self._seams.copy()
        self._before: Mask = np.zeros_like(rest.visible)
        self._remembers = False

    @property
    def lasting(self) -> Mask:
        """(rows, cols) nodes that fail again and again."""
        return np.asarray(self._left >= LASTING_FRAMES)

    def take_reference(self, residual: Residual) -> None:
        """Take the light at rest from a residual; nodes that fail even then, or at its edge, never count."""
        self._light = residual.mean.copy()
        self._never = (residual.flags != 0) | grown(residual.flags & _LIGHT_LOST != 0, EDGE_NODES)
        self._never |= self._seams
        self._flat[:] = 0

    def forget(self) -> None:
        """Begin again: what fails while the mirror moves is seen again when it rests."""
        if self._remembers:
            self._left[:] = 0
            self._before[:] = self._remembers = False

    def look(self, residual: Residual, measured: Warp, thought: Float) -> Mask | None:
        """Remember the nodes (rows, cols) that fail in a frame, and return them; None for none.

        thought: (rows, cols, 2) LCD px, where nodes were thought to look before this frame.
        """
        failing = self._fail(residual, measured.flags, thought)
        if failing is None:
            self.forget()
            return None
        self._remembers = True
        dirty = failing & self._lie_flat(failing | (self._left > 0), measured)
        failing &= ~dirty
        self._flat += dirty
        self._never |= self._flat >= DIRTY_FRAMES
        self._left[failing] = np.minimum(self._left[failing] + FAILING_FRAMES, MOST_FRAMES)
        self._left -= ~failing & (self._left > 0)
        self.need = self._left >= FAILING_FRAMES
        new = np.count_nonzero(self.need & ~self._before)
        self.grows = bool(new > GROWS_SHARE * np.count_nonzero(self.need))
        self._before |= self.need
        return failing

    def brighter(self, residual: Residual, nodes: Mask) -> bool:
        """Whether most of some nodes (rows, cols) gained more light since rest than the others."""
        if self._light is None or not residual.valid.any():
            return False
        over = (residual.mean - self._black) / np.maximum(self._light - self._black, 1e-6)
        return bool(np.median(over[nodes]) > BRIGHTER * np.median(over[residual.valid]))

    def _fail(self, residual: Residual, flags: Flags, thought: Float) -> Mask | None:
        """(rows, cols) nodes that cannot be nulled, in patches that have light everywhere; None for none."""
        rest, grid = self._rest, self._rest.grid
        if self._light is None:
            return None
        failing: Mask = (flags & CANNOT != 0) & (flags & _FOR_NOW == 0) & rest.visible & ~self._never
        if not (failing.any() or self._left.any()):
            return None
        around = _around(failing)
        here, spacing_px = (thought[around], rest.q[around]), grid.spacing_px
        areas = rest.areas[around]
        there = warp_flags(*here, grid.period_px, rest.display_size, spacing_px=spacing_px, rest_areas=areas)
        failing[around] &= there & _OFF_DISPLAY == 0
        lit = residual.mean - self._black > LIT_SHARE * (self._light - self._black)
        dark = grown(rest.visible & ~lit, REACH_NODES)
        count, patches = cv2.connectedComponents((grown(failing, 1) | dark).astype(np.uint8), connectivity=8)
        touched = np.bincount(patches[dark], minlength=count) > 0
        alone: Mask = failing & ~touched[patches]
        return alone

    def _lie_flat(self, nodes: Mask, measured: Warp) -> Mask:
        """Those of some nodes (rows, cols) in patches around which the mirror is as flat as at rest.

        What fails there does not fail for how it is bent. Where no node around was measured it may be.
        """
        if not nodes.any():
            return nodes
        side = np.ones((2 * REACH_NODES + 1, 2 * REACH_NODES + 1), np.uint8)
        away, valid = (measured.q - self._rest.q).astype(np.float32), measured.valid[..., None]
        most = cv2.dilate(np.where(valid, away, -_FAR), side)
        bent = (most - cv2.erode(np.where(valid, away, _FAR), side)).max(axis=-1)
        count, patches = cv2.connectedComponents(cv2.dilate(nodes.view(np.uint8), side))
        curved = np.bincount(patches[nodes & ((bent < 0) | (bent >= BENT_LCD_PX))], minlength=count) > 0
        return np.asarray(nodes & ~curved[patches])


def _around(nodes: Mask) -> tuple[slice, slice]:
    """The part of the lattice with these nodes (rows, cols) and those that their derivatives reach."""
    reached = (np.flatnonzero(nodes.any(axis=axis)) for axis in (1, 0))
    down, across = (slice(max(at[0] - 2, 0), at[-1] + 3) if len(at) else slice(0, 0) for at in reached)
    return down, across


def grown(nodes: Mask, by: int) -> Mask:
    """(rows, cols) nodes and those within so many of them."""
    side = 2 * by + 1
    out: Mask = cv2.dilate(nodes.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)
    return out


def joined_to(known: Mask, need: Mask, measurable: Mask) -> Mask:
    """Nodes to be read: those in need, and around them as far as where it is known where nodes look.

    The edge of a light may lie between, which takes the carrier and leaves coded pictures.
    """
    region = grown(need, REACH_NODES) & measurable
    for _ in range(FURTHER):
        labels = cv2.connectedComponents(region.astype(np.uint8), connectivity=8)[1]
        cut_off = region & ~np.isin(labels, labels[region & known])
        if not cut_off.any():
            break
        region |= grown(cut_off, REACH_NODES) & measurable
    return region
