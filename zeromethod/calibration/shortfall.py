"""Parts of a calibration that were not measured, or not well enough: each counts in the verdict."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace


class Part(enum.StrEnum):
    """A part of the procedure that may be left out or fail while the others stand."""

    LIGHT = "light"
    PANEL = "scan-out and rise"
    DELAY = "delay"
    PRESSES = "presses"


class Lack(enum.StrEnum):
    """What a part lacks."""

    SKIPPED = "left out"
    BOUNDED = "known to a range only"
    FAILED = "failed"
    HELD = "failed, though the loop held every press"


@dataclass(frozen=True)
class Shortfall:
    """A part that is not as it should be. why: what is used in place of it, or what went wrong."""

    part: Part
    lack: Lack
    why: str

    @property
    def fatal(self) -> bool:
        """Whether the loop that follows cannot be relied on."""
        return self.part is Part.DELAY and self.lack is Lack.FAILED

    def after_presses(self) -> Shortfall:
        """The same once the loop has held every press that was asked for: it can be relied on, then."""
        return replace(self, lack=Lack.HELD) if self.fatal else self

    @property
    def words(self) -> str:
        """For a person."""
        return f"{self.part}: {self.lack}: {self.why}"
