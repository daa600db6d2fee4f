"""The baseline controller: a classical leaky integrator of the residual that ignores delay."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.sensing.residual import Residual
from zeromethod.warp.compose import compose
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

_TOLERATED = np.uint16(Flag.MIXED)


class Integrator:
    """c <- q_rest + (1 - leak) (c((u, v) + gain d) - q_rest), c the warp commanded last.

    It applies the residual to the latest command though the frame was exposed to an older one, so that delay
    makes it overshoot and, at higher gain, diverge; its leak pulls a lasting dent back to rest by about
    leak / gain of its depth. The composition controller is compared against it.
    """

    keeps_pictures = False

    def __init__(self, rest: Rest, gain: float = 0.3, leak: float = 0.01) -> None:
        self._rest = rest
        self._gain = gain
        self._keep = 1.0 - leak
        self._flags = rest.flags.copy()
        self._sigma = np.zeros(rest.q.shape)
        self.commanded: Float = rest.q.copy()

    def set_gain(self, gain: float) -> None:
        """Apply this share of the residual from now on."""
        self._gain = gain

    @property
    def estimate(self) -> Float:
        """(rows, cols, 2) LCD px: the command itself."""
        return self.commanded

    def update(
        self,
        residual: Residual,
        measured: Warp,
        horizon_s: Float | None = None,  # noqa: ARG002 - ignores delay
        unsteady: Mask | None = None,  # noqa: ARG002 - the leak steadies them
    ) -> bool:
        """Take in one frame; False when it has no valid node."""
        flags = measured.flags & ~_TOLERATED
        moved = compose(self.commanded, self._gain * residual.d, self._rest.grid.spacing_px)
        valid = (flags == 0) & np.isfinite(moved).all(axis=-1)
        if not valid.any():
            return False
        displacement = self._keep * (moved - self._rest.q)
        continue_smoothly(displacement, valid, out=displacement)
        self._flags = measured.flags
        self._sigma = measured.sigma
        self.commanded = self._rest.q + displacement
        return True

    def filtered(self, time_ns: int) -> Warp:
        """The command as a warp, with the last frame's sigma and flags."""
        return Warp(self.commanded, self._sigma, self._flags, time_ns)
