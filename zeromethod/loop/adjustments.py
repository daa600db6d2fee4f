"""Settings of a loop that may be changed while it runs."""

from __future__ import annotations

from dataclasses import replace

from zeromethod.control.controller import Controller
from zeromethod.errors import InputError
from zeromethod.loop.drawing import Drawing
from zeromethod.pattern import Target
from zeromethod.rig.model import Rig

LEAST_CONTRAST = 0.1
"""Contrast of the target below which too little of it is seen to be measured."""


class Adjustments:
    """Gain of the controller and contrast of the target, of a loop that runs; used in the loop's thread."""

    def __init__(self, rig: Rig, controller: Controller, drawing: Drawing) -> None:
        """Begin with the rig's."""
        self.gain = rig.control.gain
        self.target = Target.from_spec(rig.target)
        self._controller, self._drawing = controller, drawing

    @property
    def most_contrast(self) -> float:
        """Contrast at which the target's brightest places take all the light that the LCD has."""
        return min(1.0, 1.0 / self.target.mean - 1.0)

    def set_gain(self, gain: float) -> None:
        """Apply this share of each correction, 0 to 1, from the next frame on. Raises InputError."""
        if not 0.0 < gain <= 1.0:
            raise InputError(f"gain: {gain:g}: allowed: above 0, up to 1")
        self._controller.set_gain(gain)
        self.gain = gain

    def set_contrast(self, contrast: float) -> None:
        """Draw the target with this contrast from the next picture on. Raises InputError."""
        if self.target.kind not in {"cosines", "checker"}:
            raise InputError(
                f"target: the contrast of {self.target.kind!r} is part of what frames are compared with: "
                "change [target] in the rig file"
            )
        if not LEAST_CONTRAST <= contrast <= self.most_contrast:
            raise InputError(
                f"target: contrast {contrast:g}: allowed: {LEAST_CONTRAST:g} to {self.most_contrast:.3g}"
            )
        self.target = self._drawing.target = replace(self.target, contrast=contrast)
