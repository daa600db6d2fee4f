"""Measured warps with what their zero leaves open of depth."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from zeromethod.arrays import Float
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

if TYPE_CHECKING:
    from zeromethod.calibration.left_open import LeftOpen


class ZeroDoubt:
    """States what the zero of a warp leaves open, worked out once per zero, the first takes 0.1 s."""

    def __init__(self, rig: Rig, rest: Rest) -> None:
        self._rig, self._rest = rig, rest
        self._zero: Float | None = None
        self._left_open: GeometrySpec | None = None

    @cached_property
    def _of_rig(self) -> LeftOpen:
        from zeromethod.calibration.left_open import LeftOpen  # noqa: PLC0415 - loads slowly

        return LeftOpen(self._rig, self._rest)

    def stated(self, warp: Warp, zero: Float | None) -> Warp:
        """A warp from a zero, (rows, cols, 2) LCD px, None for the rig's rest, with what that leaves open."""
        if zero is None or self._rig.geometry.relative:
            return warp
        if zero is not self._zero and (self._zero is None or not np.array_equal(zero, self._zero)):
            self._left_open = self._of_rig.geometry(zero)
        self._zero = zero
        return replace(warp, left_open=self._left_open)
