"""LEDs and detectors that fail during a run: found by the residuals of the fit, named, and left out."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.light_array.devices import FULL_SCALE, Counts
from zeromethod.light_array.estimate import Fit, each_led
from zeromethod.light_array.finer import FinerDents
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.start import SATURATED, Start

OUTLIER = 6.0
"""Residual, in robust standard deviations, above which a detector is not used in a frame."""

_NAMED_AFTER = 25
"""After so many consecutive frames, 5 ms, in which it was not used, a channel is named and left out."""

_SLOW = 500
"""Frames over which residuals are averaged to find slow drift."""

_LEAST_DRIFT = 0.25
"""Mean residual, in sigmas of a reading, below which a channel does not count as drifting."""

_SUDDEN = 2.0
"""Mean residual, in sigmas, that drift does not reach before it is found: more came suddenly."""

_DEAD = 0.005
"""Light below which a detector is dead."""

_FOOTPRINT = 0.05
"""Detectors that see at least this share of the most that any sees of an LED are around it."""

_WHOLE = 0.85
"""Share of the squared residuals around an LED that it must explain to be left out at once."""

_DARK = -0.7
"""Change of an LED's light, of all of it, from which it is dead."""


class Channels:
    """Which LEDs and detectors are used.

    faults: names of those left out for good, and why. led: (256,) gains, 0 where left out. alive: (256,)
    detectors that are not left out for good; read: those of them that were not saturated in the last frame;
    used: those that count in the next one. strange: how many of `read` were off. pressed: set from outside
    while a narrow dent is certain; detectors that are off are used all the same then.
    """

    def __init__(self, start: Start, finer: FinerDents) -> None:
        self._start, self._finer = start, finer
        finer.begin(start)
        self.faults = dict(start.faults)
        self.led = start.led.copy()
        self.alive: Mask = np.isfinite(start.detector)
        self.used: Mask = self.alive.copy()
        self.read: Mask = self.alive.copy()
        self.strange = 0
        self.pressed = False
        self._running = np.zeros(COUNT, np.int64)
        self._mean = np.zeros(COUNT)
        self._frames = 0

    def see(self, found: Fit, counts: Counts, shown: Float, at_rest: bool) -> list[str]:
        """Take a frame's residuals; return notes on channels that are left out from now on.

        counts, shown: what the detectors read, and the levels (256,) that were lit, 1 for full light.
        at_rest: nothing presses. Only then are channels left out: a narrow dent would pass for a fault.
        """
        off = np.abs(found.left) > OUTLIER * max(found.scale, 1.0)
        self._running = np.where(off, self._running + 1, 0)
        self.read = self.alive & (counts <= SATURATED * FULL_SCALE)
        self.used = self.read if self.pressed else self.read & ~off
        self.strange = int(np.count_nonzero(self.read & off))
        if not at_rest:
            return []
        named = []
        left = np.where(self.alive, found.left, 0.0)
        lasting = self.alive & (self._running >= _NAMED_AFTER)
        if lasting.any():
            columns = each_led(found.look) * (self.led * shown) / self._start.model.sigma
            named += self._dead(columns, left, counts, lasting)
        self._mean += (left - self._mean) / min(self._frames + 1, _SLOW)
        self._frames += 1
        if self._frames % _SLOW == 0:
            named += self._drifting()
        return named

    def _dead(self, columns: Float, left: Float, counts: Counts, lasting: Mask) -> list[str]:
        """Leave out the one channel, dead or saturated, that explains most of the residuals left.

        columns: (detectors, LEDs) light of each LED, in sigmas of a reading. lasting: (256,) detectors that
        have been off for long enough. Several of them around one place may be a narrow dent.
        """
        columns = np.where(self.alive[:, None], columns, 0.0)
        share = columns.T @ left
        power = np.sum(columns**2, axis=0)
        explained = np.divide(share**2, power, out=np.zeros(COUNT), where=power > 1)
        # a dead LED explains all that is left around it; of two dead detectors side by side one explains half
        noise = (1.4826 * float(np.median(np.abs(left[self.alive])))) ** 2
        place = (columns > _FOOTPRINT * columns.max(axis=0)).T
        around = place @ np.maximum(left**2 - noise, 0.0)
        explained[(explained < _WHOLE * around) | (share >= _DARK * power)] = 0.0
        alone = lasting & (~self.read | (self._start.reading(counts) < _DEAD))
        detector, led = int(np.argmax(np.abs(left) * alone)), int(np.argmax(explained))
        if explained[led] > (left[detector] ** 2 if alone[detector] else 0.0):
            return self._leave_out(led, "dead", led=True)
        if alone[detector]:
            return self._leave_out(detector, "dead" if self.read[detector] else "saturated", led=False)
        return []

    def _drifting(self) -> list[str]:
        """Leave out the one channel that explains the mean residual, unless a dent explains it better."""
        limit = max(OUTLIER * 1.4826 * float(np.median(np.abs(self._mean[self.alive]))), _LEAST_DRIFT)
        if not ((np.abs(self._mean) > limit) & (np.abs(self._mean) < _SUDDEN)).any():
            return []
        found = self._finer.channel(self._mean, _SLOW)
        return [] if found is None else self._leave_out(found[0], "drifting", led=found[1])

    def _leave_out(self, number: int, word: str, *, led: bool) -> list[str]:
        """Leave out a channel for good; a note for the operator."""
        if led:
            self.led[number] = 0.0
        else:
            self.alive[number] = False
            self._finer.use(self.alive)
        self._mean[:] = 0.0
        self._frames = 0
        name = f"{'LED' if led else 'detector'} {number}"
        self.faults[name] = word
        return [f"{name} is {word} and left out"]
