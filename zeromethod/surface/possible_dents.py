"""Dents of all loads that may press on one body, as the blocks of one view see them."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.mechanics.gaussian_load import Elastic, Loads
from zeromethod.warp.blocks import Blocks

_AT_ONCE = 128
"""Loads whose fields are worked out together: some 8 MB."""
_KEPT = 6
"""Fields of bodies and views that a process keeps for its next readers, 6 MB each."""


class PossibleDents:
    """Fields of dents 1 mm deep; worked out when first asked for, in half a second."""

    def __init__(self, body: Elastic, loads: Loads, blocks: Blocks, x_mm: Float, y_mm: Float) -> None:
        """x_mm, y_mm: (rows, cols) mirror points at rest."""
        self.loads = loads
        self._body, self._blocks, self._points = body, blocks, (x_mm, y_mm)

    @cached_property
    def fields(self) -> Single:
        """(3, blocks, loads) means of depth, and of slopes along x and y, 1/mm."""
        (x, weight), (y, _) = (self._blocks.places(one) for one in self._points)
        loads = np.stack([self.loads.x_mm, self.loads.y_mm, self.loads.width_mm])
        return _fields(self._body, np.stack([x, y, weight]).tobytes(), loads.tobytes(), x.shape)

    def seen(self, ring: Float, inverse_scale: Float, gradient: Float, used: Mask) -> tuple[Float, Float]:
        """(2 used blocks, loads) slopes less those of the ring's mean, and (loads,) that mean of depth / h.

        ring: (blocks,) weights; inverse_scale: (blocks,) 1 / h; gradient: (blocks, 2) of h, 1/mm.
        """
        depth, along, across = self.fields
        mean = (ring * inverse_scale) @ depth
        of_mean = np.outer(gradient[used].T.ravel(), mean)
        return np.concatenate([along[used], across[used]]) - of_mean, mean


@lru_cache(_KEPT)
def _fields(body: Elastic, places: bytes, loads: bytes, shape: tuple[int, int]) -> Single:
    """Of a body, at places x, y with weights, each of this shape (blocks, places of a block)."""
    x, y, weight = np.frombuffer(places).reshape(3, *shape)
    all_loads = Loads(*np.frombuffer(loads).reshape(3, -1))
    fields = body.at(x.ravel(), y.ravel())
    out = np.empty((3, len(x), len(all_loads)), np.float32)
    for start in range(0, len(all_loads), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        at = fields(all_loads[part]).reshape(3, *shape, -1)
        out[:, :, part] = np.einsum("kbpn,bp->kbn", at, weight, optimize=True)
    return out
