"""Nodes around which the mirror is as flat as at rest: what fails there does not fail for how it is bent."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.warp.warp import Warp

BENT_LCD_PX = 2.0
"""Difference of where nodes near each other look, from rest, below which the mirror is too flat to fold.
A fold displaces each node by as much as its distance from the next, some 8 LCD px; dirt by less than half a
one."""
_FAR = np.float32(1e6)


def flat_nodes(nodes: Mask, measured: Warp, rest_q: Float, reach: int) -> Mask:
    """Those of some nodes (rows, cols) that lie in patches with a flat mirror around.

    rest_q: (rows, cols, 2) LCD px, where all look at rest. reach: nodes around that are looked at, and that
    join a patch; where none of them was measured the mirror may be bent.
    """
    if not nodes.any():
        return nodes
    side = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    away, valid = (measured.q - rest_q).astype(np.float32), measured.valid[..., None]
    most, least = cv2.dilate(np.where(valid, away, -_FAR), side), cv2.erode(np.where(valid, away, _FAR), side)
    bent = (most - least).max(axis=-1)
    count, patches = cv2.connectedComponents(cv2.dilate(nodes.view(np.uint8), side))
    curved = np.bincount(patches[nodes & ((bent < 0) | (bent >= BENT_LCD_PX))], minlength=count) > 0
    return np.asarray(nodes & ~curved[patches])
