"""Channels that fail while it runs: found by what readings leave over, named, and left out."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.light_array.devices import FULL_SCALE, Counts
from zeromethod.light_array.estimate import Fit, Light, seen
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


_SATURATED, _DEAD = 0.98, 0.03
"""Readings, of full scale, above and below which a detector shows nothing but itself."""


class Channels:
    """Which LEDs and detectors are believed. faults: names, and why; led: (256,) gains, 0 where left out."""

    def __init__(self, start: Start) -> None:
        self.faults = dict(start.faults)
        self.led = start.led.copy()
        self.alive: Mask = start.detector > 0
        self.used: Mask = self.alive.copy()
        self._running = np.zeros(COUNT, np.int64)
        self._mean = np.zeros(COUNT)
        self._frames = 0

    def see(
        self, found: Fit, counts: Counts, light: Light, lit: Float, sigma: float, resting: bool
    ) -> list[str]:
        """Take what a frame left over; names of channels that are left out from now on.

        lit: (256,) levels times gains. resting: nothing presses, so that no narrow dent passes for a fault.
        """
        off = np.abs(found.left) > OUTLIER * max(found.scale, 1.0)
        self._running = np.where(off, self._running + 1, 0)
        self.used = self.alive & ~off
        named = []
        lasting = self.alive & (self._running >= _NAMED_AFTER)
        if not resting:  # then only what no mirror makes
            lasting &= (counts > _SATURATED * FULL_SCALE) | (counts < _DEAD * FULL_SCALE)
        if lasting.any():
            named.append(self._name(np.where(lasting, found.left, 0.0), counts, light, lit, sigma))
        if resting:
            self._mean += (np.where(self.alive, found.left, 0.0) - self._mean) / min(self._frames + 1, _SLOW)
            self._frames += 1
            if self._frames % _SLOW == 0:
                spread = 1.4826 * float(np.median(np.abs(self._mean[self.alive])))
                if np.abs(self._mean).max() > max(OUTLIER * spread, _LEAST_DRIFT):
                    named.append(self._name(self._mean, counts, light, lit, sigma))
        return named

    def _name(self, left: Float, counts: Counts, light: Light, lit: Float, sigma: float) -> str:
        """Leave out the one channel that explains most of what is left (256,), in sigmas."""
        columns = np.array([seen(light, one) for one in np.diag(lit)]).T / sigma
        columns[~self.alive] = 0.0
        share = columns.T @ left
        power = np.sum(columns**2, axis=0)
        explained = np.divide(share**2, power, out=np.zeros(COUNT), where=power > 1)
        detector, led = int(np.argmax(np.abs(left))), int(np.argmax(explained))
        if explained[led] > left[detector] ** 2:
            word = "dead" if share[led] < -0.9 * power[led] else "drifting"
            name = f"LED {led}"
            self.led[led] = 0.0
        else:
            level = counts[detector] / FULL_SCALE
            word = "saturated" if level > _SATURATED else "dead" if level < _DEAD else "drifting"
            name = f"detector {detector}"
            self.alive[detector] = False
        self._running[detector if name.startswith("detector") else slice(None)] = 0
        self._mean[:] = 0.0
        self._frames = 0
        self.faults[name] = word
        return f"{name} is {word} and left out"
