"""What every controller does, and which one a rig asks for."""

from __future__ import annotations

from typing import Protocol

from zeromethod.arrays import Float, Mask
from zeromethod.control.composition import Composition
from zeromethod.control.integrator import Integrator
from zeromethod.control.passive import Passive
from zeromethod.rig.model import ControlSpec
from zeromethod.sensing.residual import Residual
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp


class Controller(Protocol):
    """A controller: turns measured warps into the commanded one.

    keeps_pictures: whether others may be shown in place of its picture for some frames: the command stays as
    it is where `update` is not called. Without, there is neither order check nor coded pictures.
    """

    keeps_pictures: bool

    @property
    def commanded(self) -> Float:
        """(rows, cols, 2) LCD px to be shown next, finite everywhere."""

    @property
    def estimate(self) -> Float:
        """(rows, cols, 2) LCD px where the nodes looked in the last frame, finite everywhere."""

    def update(
        self,
        residual: Residual,
        measured: Warp,
        horizon_s: Float | None = None,
        unsteady: Mask | None = None,
    ) -> bool:
        """Take in one frame; False when the command stayed as it was.

        horizon_s: (n,) s from a frame's mid-exposure to that of the frames exposed to the resulting picture,
        from the panel's first row to its last; None while unknown. unsteady: (rows, cols) nodes to be
        followed slowly, and to stay as they are where they fail; None for none.
        """

    def set_gain(self, gain: float) -> None:
        """Apply at most this share of each correction, above 0 to 1, from the next frame on."""

    def filtered(self, time_ns: int) -> Warp:
        """Estimate of the warp, less noisy than one frame's."""


def controller_of(control: ControlSpec, rest: Rest) -> Controller:
    """Make the controller that the rig asks for."""
    if control.controller == "integrator":
        return Integrator(rest, control.gain, control.leak)
    return (Passive if control.passive else Composition)(rest, control.gain)
