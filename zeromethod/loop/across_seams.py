"""Order of the carrier across a saw's seams: where the picture goes on, it does too."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

_MOST_NODES = 24
"""Nodes of a row that a seam may take; dark of more is something else."""


@numba.njit(cache=True)
def _bridged(moved: Float, step: Float, valid: Mask, seam: Mask, out: Mask) -> None:
    """Into `out` nodes of rows, between valid ones on either side of a seam, that go on in a line.

    moved: (rows, cols) LCD px since rest, along columns. step: of the LCD position per node at rest: half a
    period, by which a line may be off.
    """
    rows, cols = valid.shape
    for j in range(rows):
        i = 0
        while i < cols:
            if valid[j, i]:
                i += 1
                continue
            end, at_seam = i, False
            while end < cols and not valid[j, end]:
                at_seam |= seam[j, end]
                end += 1
            wide = end - i + 1
            whole = at_seam and wide <= _MOST_NODES and i >= 3 and end <= cols - 3
            if whole and valid[j, i - 3 : i].all() and valid[j, end : end + 3].all():
                ahead = 0.25 * wide * (moved[j, i - 1] - moved[j, i - 3])
                back = 0.25 * wide * (moved[j, end + 2] - moved[j, end])
                if abs(moved[j, end] - back - moved[j, i - 1] - ahead) < abs(step[j, i]):
                    out[j, i:end] = True
            i = end


def bridged(q: Float, flags: Flags, rest: Rest) -> Mask | None:
    """Nodes (rows, cols) at seams over which order is known; None of a prism. q: as measured, LCD px."""
    seam = rest.flags & np.uint16(Flag.SEAM) != 0
    if not seam.any():
        return None
    out = np.zeros(seam.shape, bool)
    step = np.gradient(rest.q[..., 0], axis=1)
    _bridged(np.ascontiguousarray(q[..., 0] - rest.q[..., 0]), step, flags == 0, seam, out)
    return out
