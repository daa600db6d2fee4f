"""Channels that fail while it runs: found by what readings leave over, named, and left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.light_array.devices import FULL_SCALE, Counts
from zeromethod.light_array.estimate import Light, seen
from zeromethod.light_array.finer import FinerDents
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.start import Start

OUTLIER = 6.0
"""Residual, in robust standard deviations, from which a detector is not believed in a frame."""

_NAMED_AFTER = 25
"""Consecutive such frames until a channel is named: 5 ms."""

_SLOW = 500
"""Frames over which slow drift is averaged."""

_LEAST_DRIFT = 0.25
"""Mean residual, in sigmas of a reading, below which nothing is drift."""


_STROKE = 2.0
"""Mean residual, in sigmas, that drift does not reach before it is named."""

_SATURATED, _DEAD = 0.98, 0.005
"""Reading, of full scale, above which, and light below which a detector shows nothing but itself."""

_FOOTPRINT, _WHOLE, _DARK = 0.05, 0.85, -0.7
"""Share of an LED's greatest light that counts as its place; of what is left there that it must explain to be
to blame at once; of its light that is gone when it is called dead."""


class Seen(NamedTuple):
    """What a frame showed. left: (256,) residual, in sigmas; scale: its robust size.

    reading: (256,) light by counts. lit: (256,) levels times gains. sigma: noise of one reading.
    """

    left: Float
    scale: float
    counts: Counts
    reading: Float
    light: Light
    lit: Float
    sigma: float


class Channels:
    """Which LEDs and detectors are believed. faults: names, and why; led: (256,) gains, 0 where left out.

    strange: detectors that were off in the last frame, and are not left out for good. pressed: it is a dent
    that they see, so that they count.
    """

    def __init__(self, start: Start, finer: FinerDents) -> None:
        self._finer = finer
        finer.begin(start)
        self.faults = dict(start.faults)
        self.led = start.led.copy()
        self.alive: Mask = start.detector > 0
        self.used: Mask = self.alive.copy()
        self.strange = 0
        self.pressed = False
        self._running = np.zeros(COUNT, np.int64)
        self._mean = np.zeros(COUNT)
        self._frames = 0

    def see(self, frame: Seen, at_rest: bool) -> list[str]:
        """Take what a frame left over; names of channels that are left out from now on.

        at_rest: nothing presses, so that no narrow dent passes for a fault.
        """
        off = np.abs(frame.left) > OUTLIER * max(frame.scale, 1.0)
        self._running = np.where(off, self._running + 1, 0)
        self.used = self.alive if self.pressed else self.alive & ~off
        self.strange = int(np.count_nonzero(self.alive & off))
        if not at_rest:
            return []
        named = []
        left = np.where(self.alive, frame.left, 0.0)
        lasting = self.alive & (self._running >= _NAMED_AFTER)
        if lasting.any():
            named += self._dead(frame, left, lasting)
        self._mean += (left - self._mean) / min(self._frames + 1, _SLOW)
        self._frames += 1
        if self._frames % _SLOW == 0:
            named += self._drifting()
        return named

    def _dead(self, frame: Seen, left: Float, lasting: Mask) -> list[str]:
        """Leave out the one channel without light, or with all of it, that explains most of what is left.

        lasting: (256,) the detectors that are off. Several may be around a narrow dent.
        """
        columns = np.array([seen(frame.light, one) for one in np.diag(frame.lit)]).T / frame.sigma
        columns[~self.alive] = 0.0
        share = columns.T @ left
        power = np.sum(columns**2, axis=0)
        explained = np.divide(share**2, power, out=np.zeros(COUNT), where=power > 1)
        # a dead LED explains all that is left around it; of two dead detectors side by side one explains half
        noise = (1.4826 * float(np.median(np.abs(left[self.alive])))) ** 2
        place = (columns > _FOOTPRINT * columns.max(axis=0)).T
        around = place @ np.maximum(left**2 - noise, 0.0)
        explained[(explained < _WHOLE * around) | (share >= _DARK * power)] = 0.0
        saturated = frame.counts > _SATURATED * FULL_SCALE
        alone = lasting & (saturated | (frame.reading < _DEAD))
        detector, led = int(np.argmax(np.abs(left) * alone)), int(np.argmax(explained))
        if explained[led] > (left[detector] ** 2 if alone[detector] else 0.0):
            return self._leave_out(led, "dead", led=True)
        if alone[detector]:
            return self._leave_out(detector, "saturated" if saturated[detector] else "dead", led=False)
        return []

    def _drifting(self) -> list[str]:
        """Leave out the one channel that explains the mean of what is left, if it is no dent that does."""
        limit = max(OUTLIER * 1.4826 * float(np.median(np.abs(self._mean[self.alive]))), _LEAST_DRIFT)
        # what is off at a stroke is a dent, or a fault that shows by its light alone
        if not ((np.abs(self._mean) > limit) & (np.abs(self._mean) < _STROKE)).any():
            return []
        found = self._finer.channel(self._mean, _SLOW)
        return [] if found is None else self._leave_out(found[0], "drifting", led=found[1])

    def _leave_out(self, number: int, word: str, *, led: bool) -> list[str]:
        """Leave out a channel for good; what to say of it."""
        if led:
            self.led[number] = 0.0
            self._running[:] = 0
        else:
            self.alive[number] = False
            self._running[number] = 0
            self._finer.use(self.alive)
        self._mean[:] = 0.0
        self._frames = 0
        name = f"{'LED' if led else 'detector'} {number}"
        self.faults[name] = word
        return [f"{name} is {word} and left out"]
