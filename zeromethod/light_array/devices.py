"""What arrays of LEDs and detectors must do: take levels, give readings, keep one clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zeromethod.light_array.rig import LightArrayRig

Counts = NDArray[np.uint16]
"""(256,) levels of LEDs or readings of detectors, 0 to 65535."""

FULL_SCALE = 65535


@dataclass(frozen=True, slots=True)
class Readings:
    """One reading of every detector.

    number: of the reading, one more for each that the arrays took. shown: number of the levels that were lit.
    time_ns: middle of the reading, by the arrays' clock.
    """

    number: int
    shown: int
    time_ns: int
    counts: Counts


class ArraysLost(Exception):
    """The link to the arrays broke; they may be opened again."""


class LightArrays(Protocol):
    """Arrays, real or simulated."""

    live: bool

    @property
    def refused(self) -> int:
        """Frames that came broken so far."""

    def send(self, number: int, levels: Counts) -> None:
        """Have levels lit, as soon as may be. Raises ArraysLost."""

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings, None where none came in time. Raises ArraysLost."""

    def reopen(self) -> bool:
        """Try once to open what was lost."""

    def close(self) -> None:
        """Let go of the arrays; the LEDs keep their levels."""


def open_arrays(rig: LightArrayRig) -> LightArrays:
    """Arrays that a rig names. Raises InputError, one line, for an address that cannot be opened."""
    address = rig.arrays.address
    if address == "simulated":
        from zeromethod.light_array.simulated import SimulatedArrays  # noqa: PLC0415 - as below

        return SimulatedArrays(rig)
    from zeromethod.light_array.link import LinkedArrays  # noqa: PLC0415 - simulated ones need none

    return LinkedArrays(address)
