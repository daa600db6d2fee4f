"""Channels that fail while it runs: found by what readings leave over, named, and left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.light_array.devices import FULL_SCALE, Counts
from zeromethod.light_array.estimate import Light, seen
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import SIDE
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

    strange: detectors that were off in the last frame, and are not left out for good.
    """

    def __init__(self, start: Start) -> None:
        self.faults = dict(start.faults)
        self.led = start.led.copy()
        self.alive: Mask = start.detector > 0
        self.used: Mask = self.alive.copy()
        self.strange = 0
        self._running = np.zeros(COUNT, np.int64)
        self._mean = np.zeros(COUNT)
        self._frames = 0

    def see(self, frame: Seen, at_rest: bool) -> list[str]:
        """Take what a frame left over; names of channels that are left out from now on.

        at_rest: nothing presses, so that no narrow dent passes for a fault.
        """
        off = np.abs(frame.left) > OUTLIER * max(frame.scale, 1.0)
        self._running = np.where(off, self._running + 1, 0)
        self.used = self.alive & ~off
        self.strange = int(np.count_nonzero(self.alive & off))
        if not at_rest:
            return []
        named = []
        lasting = self.alive & (self._running >= _NAMED_AFTER)
        if lasting.any():
            named += self._name(frame, np.where(self.alive, frame.left, 0.0), lasting, slow=False)
        left = np.where(self.alive, frame.left, 0.0)
        self._mean += (left - self._mean) / min(self._frames + 1, _SLOW)
        self._frames += 1
        if self._frames % _SLOW == 0:
            limit = max(OUTLIER * 1.4826 * float(np.median(np.abs(self._mean[self.alive]))), _LEAST_DRIFT)
            # what is off at a stroke is a dent, or a fault that shows by its light alone
            drifting = (np.abs(self._mean) > limit) & (np.abs(self._mean) < _STROKE)
            if drifting.any():
                named += self._name(frame, self._mean, drifting, slow=True)
        return named

    def _name(self, frame: Seen, left: Float, doubted: Mask, *, slow: bool) -> list[str]:
        """Leave out the one channel that explains most of what is left (256,), in sigmas, if any does.

        doubted: (256,) the detectors that are off. A detector alone among its neighbours is to blame itself;
        several may be around a narrow dent. At once, only what has no light at all, or all, is a fault.
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
        dark = share < _DARK * power
        if slow:
            explained[place @ (np.abs(left) >= _STROKE) > 0] = 0.0
        else:
            explained[(explained < _WHOLE * around) | ~dark] = 0.0
        saturated, dead = frame.counts > _SATURATED * FULL_SCALE, frame.reading < _DEAD
        alone = doubted & ((_neighbours(doubted & ~dead & ~saturated) == 0) & slow | dead | saturated)
        detector, led = int(np.argmax(np.abs(left) * alone)), int(np.argmax(explained))
        if explained[led] > (left[detector] ** 2 if alone[detector] else 0.0):
            name, word = f"LED {led}", "dead" if dark[led] else "drifting"
            self.led[led] = 0.0
            self._running[:] = 0
        elif alone[detector]:
            name = f"detector {detector}"
            word = "saturated" if saturated[detector] else "dead" if dead[detector] else "drifting"
            self.alive[detector] = False
            self._running[detector] = 0
        else:
            return []
        self._mean[:] = 0.0
        self._frames = 0
        self.faults[name] = word
        return [f"{name} is {word} and left out"]


def _neighbours(of: Mask) -> Ints:
    """(256,) how many of a detector's eight neighbours are in a set."""
    padded = np.pad(of.reshape(SIDE, SIDE).astype(np.int64), 1)
    total = sum(np.roll(padded, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1))
    return np.asarray((total - padded)[1:-1, 1:-1].ravel())
