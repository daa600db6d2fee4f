"""An approaching object at one instant, as the watch camera measures it."""

from __future__ import annotations

import enum
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

NAN = float("nan")


class Watching(enum.StrEnum):
    """State of the watch camera: what it sees, or why it sees nothing."""

    STARTING = "starting"
    CLEAR = "clear"
    SEEN = "seen"
    COMING = "coming"
    STALLED = "watch camera stalled"
    LOST = "watch camera lost"
    BLIND = "watch camera blind"


FAULTY = frozenset({Watching.STALLED, Watching.LOST, Watching.BLIND})
"""States in which it is not known whether anything comes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """An approaching object, by one frame of the watch camera; NaN: not known.

    time_ns: mid-exposure of that frame. height_mm: of its lowest point above the mirror. speed_mm_s: at which
    it comes down, positive towards the mirror. contact_s: time from time_ns until it touches; x_mm, y_mm:
    where on the mirror. diameter_mm: its width; of a long object the shorter one. sigma_...: standard
    deviations. reason: in words, why a camera at fault sees nothing.
    """

    watching: Watching
    time_ns: int = 0
    height_mm: float = NAN
    sigma_height_mm: float = NAN
    speed_mm_s: float = NAN
    sigma_speed_mm_s: float = NAN
    contact_s: float = NAN
    sigma_contact_s: float = NAN
    x_mm: float = NAN
    y_mm: float = NAN
    sigma_x_mm: float = NAN
    sigma_y_mm: float = NAN
    diameter_mm: float = NAN
    sigma_diameter_mm: float = NAN
    reason: str = ""

    @classmethod
    def of_row(cls, row: np.void) -> Approach:
        """From a row of a recording's table `approaches`, which has no reason."""
        names = {one.name for one in fields(cls)} & set(row.dtype.names or ())
        values: dict[str, Any] = {name: row[name].item() for name in names}
        return cls(**values | {"watching": Watching(row["watching"].decode())})

    @property
    def armed(self) -> bool:
        """Whether a touch is expected, so that the loop waits for it."""
        return self.watching is Watching.COMING

    @property
    def words(self) -> str:
        """For the operator."""
        if not self.armed:
            return f"{self.watching}: {self.reason}" if self.reason else str(self.watching)
        return (
            f"touch expected in {self.contact_s:.3f} ± {self.sigma_contact_s:.3f} s "
            f"at ({self.x_mm:.1f}, {self.y_mm:.1f}) ± {max(self.sigma_x_mm, self.sigma_y_mm):.1f} mm"
        )
