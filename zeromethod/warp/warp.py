"""A warp: per node, the LCD position that the camera node looks at, or is made to look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Flags, Float, Mask


@dataclass(frozen=True, slots=True)
class Warp:
    """LCD position per node of a `NodeGrid`.

    q: (rows, cols, 2) float64, LCD (column, row) in px, pixel centres at integers.
    sigma: (rows, cols, 2) float64, standard deviation of q in LCD px.
    flags: (rows, cols) uint16 of `Flag` bits; 0 = valid.
    time_ns: when it was true (measured: mid-exposure; shown: presentation).
    """

    q: Float
    sigma: Float
    flags: Flags
    time_ns: int

    @property
    def valid(self) -> Mask:
        """(rows, cols) nodes that may be trusted."""
        return np.equal(self.flags, 0)
