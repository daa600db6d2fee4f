"""Delivery of camera frames: the camera's timeline with its planted faults."""

from __future__ import annotations

import math

from zeromethod.rig.model import Rig
from zeromethod.simulation.timeline import Timeline

_STREAM = 2
_BACKLOG_NS = 1000
"""Frames behind a late one arrive this far apart, so that the late one is really delivered."""


class Delivery:
    """Start, arrival and fate of every frame, by number; any number may be asked for at any time.

    A frame is there `camera_latency_s` after the end of its exposure. Dropped frames never arrive, nor do
    those of a stall (from `stall_at_frame` on, for `stall_s`). A late frame arrives `late_s` later, and the
    frames behind it wait for it. The camera is gone from when frame `camera_lost_at_frame` would arrive,
    for `camera_back_after_s` or for good.
    """

    def __init__(self, rig: Rig) -> None:
        spec = rig.simulation
        self._faults = spec.faults
        rate_hz = spec.camera_rate_hz or rig.camera.rate_hz
        self._timeline = Timeline(rate_hz, spec.camera_phase, spec.camera_jitter_s, spec.seed, _STREAM)
        self._exposures_ns = [(-math.inf, max(2, round(rig.camera.exposure_s * 1e9)))]
        self._latency_ns = round(spec.camera_latency_s * 1e9)
        self._late_ns = round(self._faults.late_s * 1e9)

    def expose(self, from_ns: int, exposure_ns: int) -> None:
        """Have frames that start at `from_ns`, which only grows, or later exposed for so long."""
        self._exposures_ns.append((from_ns, exposure_ns))

    def exposure_ns(self, number: int) -> int:
        """How long frame `number` is exposed."""
        start_ns = self.start_ns(number)
        return next(length for since_ns, length in reversed(self._exposures_ns) if since_ns <= start_ns)

    def start_ns(self, number: int) -> int:
        """Start of the exposure of frame `number`."""
        return self._timeline.time_ns(number)

    def first_from(self, time_ns: int) -> int:
        """First frame whose exposure starts at or after `time_ns`."""
        return self._timeline.first_after(time_ns - 1)

    def arrival_ns(self, number: int) -> int:
        """When frame `number` is in the host's hands, were it delivered."""
        own = self._timely_ns(number)
        if number in self._faults.late_frames:
            own += self._late_ns
        behind = (
            self._timely_ns(late) + self._late_ns + _BACKLOG_NS * (number - late)
            for late in self._faults.late_frames
            if late < number
        )
        return max((own, *behind))

    def delivered(self, number: int) -> bool:
        """Whether frame `number` arrives at all."""
        return number not in self._faults.drop_frames and not self._stalled(number)

    def newest_until(self, time_ns: int, after: int) -> int | None:
        """Newest frame above `after` that has arrived by `time_ns`."""
        return next((n for n in reversed(self._due(time_ns, after)) if self._arrived(n, time_ns)), None)

    def next_until(self, time_ns: int, after: int) -> int | None:
        """First frame above `after` that arrives by `time_ns`."""
        return next((n for n in self._due(time_ns, after) if self._arrived(n, time_ns)), None)

    def _due(self, time_ns: int, after: int) -> range:
        """Frames above `after` that are there by `time_ns` if nothing delays them."""
        soonest_ns = min(length for _, length in self._exposures_ns) + self._latency_ns
        return range(after + 1, self._timeline.last_until(time_ns - soonest_ns) + 1)

    def _arrived(self, number: int, time_ns: int) -> bool:
        return self.delivered(number) and self.arrival_ns(number) <= time_ns

    def lost_at(self) -> int | None:
        """When the camera vanishes, ns; None = never."""
        number = self._faults.camera_lost_at_frame
        return None if number is None else self.arrival_ns(number)

    def gone(self, time_ns: int) -> bool:
        """Whether the camera cannot be opened at `time_ns`."""
        lost_ns, back_s = self.lost_at(), self._faults.camera_back_after_s
        if lost_ns is None or time_ns < lost_ns:
            return False
        return back_s is None or time_ns < lost_ns + round(back_s * 1e9)

    def repeated(self, number: int) -> bool:
        """Whether frame `number` repeats the image of the frame before it."""
        return number in self._faults.repeat_frames

    def torn(self, number: int) -> bool:
        """Whether the lower half of frame `number` is still that of the frame before it."""
        return number in self._faults.torn_frames

    def lit(self, number: int) -> bool:
        """Whether the panel gives light during frame `number` (`light_off_frames`: first and last dark)."""
        dark = self._faults.light_off_frames
        return dark is None or not dark[0] <= number <= dark[1]

    def oldest_used(self, number: int) -> int:
        """Earliest frame whose exposure is looked at for frame `number` or any later one."""
        while self.repeated(number):
            number -= 1
        return number - 1

    def _timely_ns(self, number: int) -> int:
        return self.start_ns(number) + self.exposure_ns(number) + self._latency_ns

    def _stalled(self, number: int) -> bool:
        first = self._faults.stall_at_frame
        if first is None or number < first:
            return False
        return self._timely_ns(number) < self._timely_ns(first) + round(self._faults.stall_s * 1e9)
