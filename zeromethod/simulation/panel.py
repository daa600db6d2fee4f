"""The simulated LCD: each row's share of every picture in an interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.rig.model import DisplaySpec
from zeromethod.simulation.renderer import Handle

NEGLIGIBLE = 1e-5
"""Pictures that give less than this of any row's light are left out."""
SETTLED = 12.0
"""Time constants after which a replaced picture gives less than `NEGLIGIBLE`."""


class Presentation(NamedTuple):
    """A picture and the swap (ns) with which it starts to be scanned out."""

    time_ns: int
    handle: Handle


class SimulatedPanel:
    """An LCD's rows in time.

    A row starts towards a new picture at presentation + latency + its share of the scan-out (row 0 none,
    the last row all of it; the other way round with scan "up") and follows exponentially, with time
    constant rise_s / ln 9 (10 to 90 %).
    """

    def __init__(self, display: DisplaySpec, refresh_hz: float) -> None:
        self._scanout_s = 1.0 / refresh_hz if display.scanout_s is None else display.scanout_s
        self._tau_s = display.rise_s / math.log(9.0)
        share = np.arange(display.rows) / (display.rows - 1)
        if display.scan == "up":
            share = share[::-1]
        self._row_delay_s = display.latency_s + share * self._scanout_s
        self._slowest_ns = round((display.latency_s + self._scanout_s + SETTLED * self._tau_s) * 1e9)

    def forgotten_at(self, replaced_ns: int) -> int:
        """Time, ns, after which a picture replaced at `replaced_ns` gives no more light."""
        return replaced_ns + self._slowest_ns

    def weights(
        self, presentations: Sequence[Presentation], from_ns: int, to_ns: int
    ) -> list[tuple[Handle, Single]]:
        """Mean share of each picture in each row's light over [from_ns, to_ns].

        presentations: rising in time; the first is taken to be shown since ever. Returns (handle, (rows,)
        float32) pairs whose shares add up to 1 in every row; `to_ns` = `from_ns` gives an instant.
        """
        kept: list[tuple[Handle, Float]] = []
        until_next = np.ones(len(self._row_delay_s))
        for index, (_, handle) in enumerate(presentations):
            since_this = until_next
            until_next = np.zeros(len(self._row_delay_s))
            if index + 1 < len(presentations):
                next_ns = presentations[index + 1].time_ns
                if self.forgotten_at(next_ns) < from_ns:
                    until_next = np.ones(len(self._row_delay_s))
                    continue
                until_next = self._mean_step((from_ns - next_ns) * 1e-9, (to_ns - next_ns) * 1e-9)
            share = since_this - until_next
            if share.max() > NEGLIGIBLE:
                kept.append((handle, share))
        total = np.sum([share for _, share in kept], axis=0)
        return [(handle, (share / total).astype(np.float32)) for handle, share in kept]

    def _mean_step(self, from_s: float, to_s: float) -> Float:
        """(rows,) mean of every row's step response over an interval counted from the presentation."""
        start, end = from_s - self._row_delay_s, to_s - self._row_delay_s
        if to_s <= from_s:
            if self._tau_s == 0:
                return (start >= 0).astype(np.float64)
            risen: Float = -np.expm1(-np.maximum(start, 0.0) / self._tau_s)
            return risen
        mean: Float = (self._integral(end) - self._integral(start)) / (to_s - from_s)
        return mean

    def _integral(self, time_s: Float) -> Float:
        """Integral from 0 of the step response 1 - exp(-t / tau)."""
        time_s = np.maximum(time_s, 0.0)
        if self._tau_s == 0:
            return time_s
        area: Float = time_s + self._tau_s * np.expm1(-time_s / self._tau_s)
        return area
