"""Exposures of the monitor: each grabbed several times, equal pictures merged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from zeromethod.arrays import Bytes
from zeromethod.clock import HostClock
from zeromethod.rig.model import CameraSpec
from zeromethod.worker import Worker

GRABS = 4
"""Grabs per exposure, evenly spread: a picture's share of the light is known to a quarter."""


class Grabber(Protocol):
    """What takes the monitor's picture."""

    def grab(self) -> Bytes:
        """Grey codes (rows, cols) now."""

    def close(self) -> None:
        """Leave the screen."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """What the monitor showed during one exposure.

    number: counts the camera's frames, taken or not. time_ns: its middle. end_ns: its end. pictures: (grey
    codes, share of the exposure), in the order shown; shares add up to 1.
    """

    number: int
    time_ns: int
    end_ns: int
    pictures: tuple[tuple[Bytes, float], ...]


class Exposer:
    """Exposes at the camera's own rate in a thread of its own; keeps the newest exposure."""

    def __init__(self, camera: CameraSpec, opened: Callable[[], Grabber]) -> None:
        """Begin at once. opened: makes the grabber, in the thread that uses it."""
        self._opened = opened
        self._clock = HostClock()
        self._period_ns = 1e9 / camera.rate_hz
        self._exposure_ns = round(1e9 * camera.exposure_s)
        self._start_ns = self._clock.now_ns()
        self._worker: Worker[None, Exposure] = Worker("exposer", self._grabber, kept=1, idle=(0.0, None))

    def take(self, timeout_s: float) -> Exposure | None:
        """Newest exposure not yet taken, None when none comes in time; raises what grabbing raised."""
        taken = self._worker.take(timeout_s)
        return taken[-1] if taken else None

    def close(self) -> None:
        """Stop; safe to call twice."""
        self._worker.close(1.0)

    @contextmanager
    def _grabber(self) -> Iterator[Callable[[None], Exposure]]:
        with closing(self._opened()) as grabber:
            yield lambda _: self._expose(grabber)

    def _expose(self, grabber: Grabber) -> Exposure:
        number = int((self._clock.now_ns() - self._start_ns) // self._period_ns) + 1
        start_ns = self._start_ns + round(number * self._period_ns)
        shots = []
        for index in range(GRABS):
            self._clock.sleep_until_ns(start_ns + self._exposure_ns * (2 * index + 1) // (2 * GRABS))
            shots.append(grabber.grab())
        middle_ns, end_ns = start_ns + self._exposure_ns // 2, start_ns + self._exposure_ns
        return Exposure(number, middle_ns, end_ns, merged(shots))


def merged(shots: list[Bytes]) -> tuple[tuple[Bytes, float], ...]:
    """Pictures and their shares; equal consecutive shots are one picture."""
    pictures: list[tuple[Bytes, float]] = []
    for shot in shots:
        if pictures and np.array_equal(shot, pictures[-1][0]):
            pictures[-1] = pictures[-1][0], pictures[-1][1] + 1 / len(shots)
        else:
            pictures.append((shot, 1 / len(shots)))
    return tuple(pictures)
