"""The controller of a pattern that is never warped, on paper or left on the LCD: nothing is nulled."""

from __future__ import annotations

from typing import Any

from zeromethod.control.composition import Composition


class Passive(Composition):
    """Follows the mirror as the composition controller does, and commands the warp at rest for ever."""

    keeps_pictures = False

    def update(self, *given: Any, **more: Any) -> bool:
        """As `Composition.update`; the command stays the same array."""
        at_rest = self.commanded
        followed = super().update(*given, **more)
        self.commanded = at_rest
        return followed
