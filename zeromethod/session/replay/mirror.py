"""The mirror of a recording as its readings give it, to move a simulated bench.

At every reading's time it is where the reading puts it; between them it moves in straight lines. It is smooth
between nodes and at rest around the view. Readings of the same mirror, but for their noise, are averaged:
otherwise noise would become motion. While something moves there is nothing to average, and the mirror has the
noise of the readings. Contacts take no light.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import SIMULATED
from zeromethod.session.replay.window import Window
from zeromethod.simulation.moving_map import MapPlacement, MovingMap
from zeromethod.simulation.scattered import ScatteredMap
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface import Surface
from zeromethod.warp.continuation import continue_smoothly

LEAD_S = 0.5
"""Time in which the mirror comes from rest where a part from the middle of a session begins..."""

BEFORE_S = 0.3
"""... to where it was so long before the part; the loop is locked when the part begins."""

LEAST_VALID = 16
"""Nodes with a depth that a reading must have."""

AVERAGED = 8
"""Readings on either side that are averaged at most."""

SAME = 1.3
"""Mean square of the slopes' differences over their variance up to which two readings are of one mirror: 1 by
noise alone, and a press of 0.5 um anywhere is 3."""


@dataclass(frozen=True)
class _Fit:
    """One reading: its map, and the slopes by which readings of the same mirror are recognised."""

    coefficients: Float
    slope: Single
    variance: Single

    def same_as(self, other: _Fit) -> bool:
        with np.errstate(invalid="ignore", divide="ignore"):
            square = (self.slope - other.slope) ** 2 / (self.variance + other.variance)
        known = square[np.isfinite(square)]
        return bool(known.size and known.mean() < SAME)


def contacts_left_out(recording: Recording, window: Window) -> int:
    """How many contacts there are in a window, which the mirror has not: it moves, and nothing touches it."""
    found = recording.contacts
    inside = (found["time_ns"] >= window.from_ns) & (found["time_ns"] <= window.to_ns)
    return len(np.unique(found["id"][inside]))


class RecordedMirror:
    """The mirror of the readings in a window, in the time of a bench whose clock starts at 0.

    shift_ns: add it to the bench's time for the recording's. settled_ns, end_ns: the bench's time at which
    what is compared begins and ends. duration_s: how long the bench must run for that.
    """

    def __init__(self, recording: Recording, window: Window) -> None:
        """Raises InputError where no surfaces were kept, or none was read in the window."""
        if "surface" not in recording.kept:
            raise InputError(f"{recording.path}: recorded without surfaces: nothing to move a mirror by")
        self._recording = recording
        steps, known = recording.steps_with("surface"), recording.steps
        steps = steps[np.isin(steps, known["number"])]
        times_ns = known["time_ns"][np.searchsorted(known["number"], steps)]
        if not np.any((times_ns >= window.from_ns) & (times_ns <= window.to_ns)):
            raise InputError(f"{recording.path}: nothing was read in this part to move a mirror by")
        period_ns = round(1e9 / recording.rig.camera.rate_hz)
        self.shift_ns = self._shift_ns(window, period_ns)
        self.settled_ns = window.from_ns - self.shift_ns
        self.end_ns = window.to_ns - self.shift_ns
        self.duration_s = 1e-9 * (self.end_ns + period_ns)
        lead = [] if window.from_start else [0, round(1e9 * LEAD_S)]
        times = [int(time) - self.shift_ns for time in times_ns]
        first = bisect_right(times, lead[-1]) if lead else 0
        # the reading after the end says where the mirror goes
        last = min(bisect_right(times, self.end_ns) + 1, len(times))
        self._lead = len(lead)
        self._steps = [int(step) for step in steps[first:last]]
        self._lay_out()
        self._fits: OrderedDict[int, _Fit | None] = OrderedDict()
        self._first: Float | None = None
        lattice = MapPlacement(self._maps.centre_mm, self._maps.pitch_mm)
        self._press = MovingMap(lattice, lead + times[first:last], self._coefficients)

    def _shift_ns(self, window: Window, period_ns: int) -> int:
        if not window.from_start:
            return window.from_ns - round(1e9 * (LEAD_S + BEFORE_S))
        # a simulated session's clock starts at 0 as the bench's does
        simulated = self._recording.rig.camera.driver == SIMULATED
        return 0 if simulated and not self._recording.live else window.start_ns - period_ns

    def _lay_out(self) -> None:
        """Fix nodes, their points at rest and the lattice."""
        recording = self._recording
        rest, optics = recording.rest, Optics(recording.rig)
        point = optics.trace(*recording.grid.mesh(), optics.rest).point
        inner = np.zeros(rest.visible.shape, dtype=np.bool_)
        inner[recording.grid.inner] = True
        self._used = rest.visible & inner & np.isfinite(point).all(axis=-1)
        self._x_mm, self._y_mm = point[self._used][:, 0], point[self._used][:, 1]
        apart = (np.linalg.norm(np.diff(point, axis=axis), axis=-1) for axis in (0, 1))
        self._maps = ScatteredMap(self._x_mm, self._y_mm, float(max(np.nanmedian(one) for one in apart)))

    def scenario(self, name: str) -> Scenario:
        """What moves the bench."""
        return Scenario(name, (self._press,), self.duration_s)

    def _coefficients(self, index: int) -> Float:
        """Map number `index`: those of the lead are rest, and the first reading; then come the readings."""
        reading = index - self._lead
        if reading > 0:
            return self._averaged(reading)
        if self._first is None:
            self._first = self._averaged(0)
        return np.zeros_like(self._first) if reading == -2 else self._first

    def _averaged(self, index: int) -> Float:
        """Mean of the readings around this one of the same mirror."""
        here = self._fit(index)
        if here is None:
            known = next((k for k in range(index - 1, -1, -1) if self._fit(k) is not None), None)
            if known is not None:
                return self._averaged(known)
            nothing = np.zeros_like(self._x_mm)
            return self._maps.fit(self._x_mm, self._y_mm, nothing)
        total, count = here.coefficients.copy(), 1
        for step in (-1, 1):
            for k in range(index + step, index + step * (AVERAGED + 1), step):
                other = self._fit(k) if 0 <= k < len(self._steps) else None
                if other is None or not here.same_as(other):
                    break
                total += other.coefficients
                count += 1
        mean: Float = total / count
        return mean

    def _fit(self, index: int) -> _Fit | None:
        """Fit of a reading; None where it has no depth."""
        if index not in self._fits:
            self._fits[index] = self._fitted(index)
            if len(self._fits) > 2 * AVERAGED + 4:
                self._fits.popitem(last=False)
        self._fits.move_to_end(index)
        return self._fits[index]

    def _fitted(self, index: int) -> _Fit | None:
        surface = self._recording.surface(self._steps[index])
        if surface is None:
            return None
        read = surface.valid & self._used & np.isfinite(surface.depth_mm)
        if np.count_nonzero(read) < LEAST_VALID:
            return None
        inside = read[..., None]
        return _Fit(
            self._maps.fit(*self._filled(surface, read)),
            np.where(inside, surface.slope, np.nan).astype(np.float32),
            np.where(inside, surface.sigma_slope**2, np.nan).astype(np.float32),
        )

    def _filled(self, surface: Surface, read: Mask) -> tuple[Float, Float, Float]:
        """(x, y, depth) of the used nodes; what was not read as the nodes around have it."""
        field = np.stack([np.where(read, surface.depth_mm, 0.0), np.zeros(read.shape)], axis=-1)
        depth_mm = continue_smoothly(field, read)[..., 0][self._used]
        here = read[self._used]
        x_mm = np.where(here, surface.x_mm[self._used], self._x_mm)
        y_mm = np.where(here, surface.y_mm[self._used], self._y_mm)
        return x_mm, y_mm, depth_mm
