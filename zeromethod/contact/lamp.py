"""Where the LCD is a lamp: inside contacts, where the carrier serves nothing.

One carrier period of collar stays between a contact's border and the lamp, so that no node outside the
contact has any of it in its window; contacts nearer than a period to each other have no collar between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Mask
from zeromethod.contact.contact import Contact
from zeromethod.contact.polygon import closed
from zeromethod.warp.grid import NodeGrid

MOST_SHARE = 0.3
"""Share of the nodes from which on there is no lamp: what covers so much may go at once, and the carrier is
to be there then."""
_FINE = 2
"""Points of the mask per node, along either axis."""
_STAYS_PX = 4.0
"""A node that is lit stays so this much nearer to the border: the border's noise lights and darkens none."""


class Lamp:
    """Nodes at which the LCD is to be white, from frame to frame."""

    def __init__(self, grid: NodeGrid) -> None:
        self._grid = grid
        self._step = grid.spacing_px / _FINE
        self._first = np.array([grid.u_px[0], grid.v_px[0]], dtype=np.float64)
        self._shape = grid.shape[0] * _FINE, grid.shape[1] * _FINE
        self._lit: Mask | None = None

    def follow(self, contacts: Sequence[Contact]) -> Mask | None:
        """(rows, cols) nodes lit with these contacts; None for none, the same array while it is the same."""
        lit = self._of(contacts) if contacts else None
        if lit is None or not lit.any() or np.mean(lit[self._grid.inner]) > MOST_SHARE:
            self._lit = None
        elif self._lit is None or not np.array_equal(lit, self._lit):
            self._lit = lit
        return self._lit

    def _of(self, contacts: Sequence[Contact]) -> Mask:
        covered = np.zeros(self._shape, np.uint8)
        for contact in contacts:
            at = (closed(contact.outline_px) - self._first) / self._step
            cv2.fillPoly(covered, [np.rint(at * 16).astype(np.int32)], 1, shift=4)
        period = self._grid.period_px / self._step
        whole = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, _disc(period / 2))
        inside = cv2.distanceTransform(whole, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[::_FINE, ::_FINE]
        inside -= 1  # the border's own points count as covered, and as one away from what is not
        lit = inside >= period
        if self._lit is not None:
            lit |= self._lit & (inside >= period - _STAYS_PX / self._step)
        return np.asarray(lit)


def _disc(radius: float) -> Bytes:
    side = 2 * round(radius) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)
