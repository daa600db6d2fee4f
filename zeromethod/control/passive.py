"""The controller of a pattern that is never warped, on paper or left on the LCD: nothing is nulled."""

from __future__ import annotations

from zeromethod.arrays import Float, Mask
from zeromethod.control.composition import Composition
from zeromethod.sensing.residual import Residual
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp


class Passive(Composition):
    """Follows the mirror as the composition controller does, and commands the warp at rest for ever."""

    def __init__(self, rest: Rest, gain: float = 1.0) -> None:
        super().__init__(rest, gain)
        self._at_rest = self.commanded

    def update(
        self,
        residual: Residual,
        measured: Warp,
        horizon_s: Float | None = None,
        unsteady: Mask | None = None,
    ) -> bool:
        """Take in one frame; False when it has no valid node."""
        followed = super().update(residual, measured, horizon_s, unsteady)
        self.commanded = self._at_rest
        return followed
