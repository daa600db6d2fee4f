"""Says once when something begins to press outside the view."""

from __future__ import annotations

import math

from zeromethod.rig.model import Rubber
from zeromethod.surface import Surface


class OutsideNote:
    """Notes of one run."""

    def __init__(self, rubber: Rubber) -> None:
        self._modulus_mpa = (rubber.youngs_modulus_mpa or math.nan) / (1 - rubber.poisson**2)
        self._said, self._note = False, ""

    def look(self, surface: Surface | None) -> None:
        """Look at the newest reading; None where there is none."""
        if surface is None:
            return
        outside = surface.anchor.outside
        if outside is not None and not self._said:
            force_n = math.pi * self._modulus_mpa * outside.q_mm2
            much = f", with about {force_n:.2g} N" if math.isfinite(force_n) else ""
            place = f"x {outside.x_mm:.0f}, y {outside.y_mm:.0f} mm"
            self._note = f"something presses outside the view, near {place}{much}: it is part of depth"
        self._said = outside is not None

    def take(self) -> tuple[str, ...]:
        """The note that has not been taken."""
        note, self._note = self._note, ""
        return (note,) if note else ()
