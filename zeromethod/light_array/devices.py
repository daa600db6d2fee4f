"""What arrays of LEDs and detectors must do: take levels, give readings, keep one clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.uint16]
"""(256,) levels of LEDs or readings of detectors, 0 to 65535."""

FULL_SCALE = 65535


@dataclass(frozen=True, slots=True)
class Readings:
    """One reading of every detector.

    number: counts the readings that the arrays took. shown: number of the levels that were lit meanwhile.
    time_ns: middle of the reading, by the arrays' clock.
    """

    number: int
    shown: int
    time_ns: int
    counts: Counts


class ArraysLost(Exception):
    """The link to the arrays broke; they may be opened again."""


class LightArrays:
    """Arrays, real or simulated. What is defined here is right for arrays that cannot be lost.

    broken: how many frames arrived damaged so far; they were dropped.
    """

    broken = 0

    def send(self, number: int, levels: Counts) -> None:
        """Have levels lit as soon as possible. Raises ArraysLost."""
        raise NotImplementedError

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings, None where none came in time. Raises ArraysLost."""
        raise NotImplementedError

    def reopen(self) -> bool:
        """Try once to open lost arrays again; whether they are open."""
        return True

    def close(self) -> None:
        """Close the link; the LEDs keep their levels."""

    def phase_at(self, time_ns: int) -> str:  # noqa: ARG002 - only simulated arrays know it
        """Part of a simulated scenario at a time of the arrays' clock, "" where unknown."""
        return ""
