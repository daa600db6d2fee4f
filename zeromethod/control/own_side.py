"""Nodes next to a saw's seam, continued from their own side of it.

Behind a seam lies a band of the mirror that is not seen: where the mirror bends, the picture jumps there. One
that goes on smoothly over the jump is off next to it on either side, in the windows of the nodes measured
there, which then read wrong.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.warp.rest import Rest
from zeromethod.warp.seams import gap_end
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


@numba.njit(cache=True)
def _extend(field: Float, known: Mask, seams: Ints, ahead: Float) -> None:
    """Fill in, in place, the first unknown nodes of rows on either side of seams between known ones."""
    cols, (filled, n) = known.shape[1], ahead.shape
    for j in range(known.shape[0]):
        i = 0
        while i < cols:
            start = i
            end, seam = gap_end(known[j], seams[j], start)
            i = end + 1
            if seam == 0 or start < n or end + n > cols or not 2 * filled <= end - start <= _MOST_NODES:
                continue
            if not (known[j, start - n : start].all() and known[j, end : end + n].all()):
                continue
            for step in range(filled):
                for k in range(2):
                    before, after = 0.0, 0.0
                    for m in range(n):
                        before += ahead[step, m] * field[j, start - 1 - m, k]
                        after += ahead[step, m] * field[j, end + m, k]
                    field[j, start + step, k], field[j, end - 1 - step, k] = before, after
                known[j, start + step] = known[j, end - 1 - step] = True


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
        _extend(field, known, self._seams, _AHEAD)
        return known
