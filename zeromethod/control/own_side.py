"""Nodes next to a saw's seam, continued from their own side of it.

Behind a seam lies a band of the mirror that is not seen: where the mirror bends, the picture jumps there. One
that goes on smoothly over the jump is off next to it on either side, in the windows of the nodes measured
there, which then read wrong.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.warp.rest import Rest
from zeromethod.warp.seams import gaps
from zeromethod.warp.validity import Flag

_NODES, _DEGREE = 5, 3
"""Nodes of a row on one side by which it is continued, and degree of their least-squares polynomial."""
_FILLED = 2
"""Nodes filled in on each side: all that a window on a measured node gives weight to."""
_MOST_NODES = 14
"""Nodes of a row that a seam may take; dark of more is something else."""
_AHEAD = np.vander(np.arange(1.0, _FILLED + 1), _DEGREE + 1) @ np.linalg.pinv(
    np.vander(-np.arange(float(_NODES)), _DEGREE + 1)
)
"""(filled, nodes) weights of nodes, nearest first, in those ahead of them."""


def _extend(field: Float, known: Mask, seams: Ints) -> None:
    """Fill in, in place, the first unknown nodes of rows on either side of seams between known ones."""
    row, first, end, _ = gaps(known, seams)
    fits = (end - first >= 2 * _FILLED) & (end - first <= _MOST_NODES)
    fits &= (first >= _NODES) & (end + _NODES <= known.shape[1])
    row, first, end = row[fits, None], first[fits, None], end[fits, None]
    away, into = np.arange(_NODES), np.arange(_FILLED)
    both = known[row, first - 1 - away].all(axis=1) & known[row, end + away].all(axis=1)
    row, first, end = row[both], first[both], end[both]
    field[row, first + into] = _AHEAD @ field[row, first - 1 - away]
    field[row, end - 1 - into] = _AHEAD @ field[row, end + away]
    known[row, first + into] = known[row, end - 1 - into] = True


class OwnSide:
    """Seams of a rig's saw, for a displacement that is about to be continued; nothing of a prism."""

    def __init__(self, rest: Rest) -> None:
        self._seams: Ints | None = None
        if rest.seams is not None:
            self._seams = (rest.flags & np.uint16(Flag.SEAM) != 0).astype(np.int64)

    def extended(self, field: Float, valid: Mask) -> Mask:
        """Valid nodes and those that were filled into `field` (rows, cols, 2) next to seams."""
        if self._seams is None:
            return valid
        known: Mask = valid.copy()
        _extend(field, known, self._seams)
        return known
