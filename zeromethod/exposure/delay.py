"""The delay between display and camera, estimated while the loop runs.

**The delay** is the time from a picture's presentation, as the display states it, until the panel's first row
begins to change, on the camera's time stamps. It is relative to the time stamps: a camera that stamps
mid-exposures and a panel that starts at once have delay 0, however late frames arrive. Stamps that are too
early make it smaller; stamps that are too late, and a display that delays pictures, make it larger. It is the
rig file's `[display] latency_s`; pairing frames with pictures needs nothing else than it and the panel's
scan-out and rise.

A frame exposed to two pictures measures it (`zeromethod.exposure.strip_matching`); others only bound it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from statistics import median

from zeromethod.arrays import Image
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.strip_matching import Match, match
from zeromethod.exposure.strip_reading import StripReader

MEMORY_FRAMES = 63
"""The running delay is the median of so many frames' delays."""

SETTLED_FRAMES = 3
"""Frames after which the running delay is trusted, if they agree within half a refresh."""

PLATEAU_REFRESHES = 0.12
"""Widest plateau of equally good delays, in refreshes, whose middle counts as a frame's own delay."""

FIRST_SPAN_REFRESHES = (-3.0, 9.0)
"""Delays searched at first: less than the 16 pictures after which codes repeat."""

SPAN_REFRESHES = 2.5
"""Delays searched on either side of a trusted running delay: pictures may be a refresh or two late."""

LATE_REFRESHES = 6.0
"""Delays searched on either side for a frame that no nearer one explains: a busy computer stamps single
frames, or pictures, several refreshes late. Together less than the 16 pictures after which codes repeat."""

LOST_AFTER = 8
"""Consecutive frames without a fit after which the full range of delays is searched again."""

LEAST_SCATTER_NS = 20_000.0
"""Smallest scatter from frame to frame that is assumed."""


class DelayEstimator:
    """Running median of the delay, robust against wrong frames. prior_ns: the value before any frame."""

    def __init__(self, prior_ns: float, refresh_ns: float) -> None:
        self._refresh_ns = refresh_ns
        self._values: deque[float] = deque(maxlen=MEMORY_FRAMES)
        self.value_ns = prior_ns
        """The delay, ns."""
        self.scatter_ns = float("inf")
        """Standard deviation of single frames' delays, ns; infinite before two."""

    @property
    def sigma_ns(self) -> float:
        """Standard deviation of the value, ns: that of a median is 1.25 times that of a mean."""
        return 1.25 * self.scatter_ns / math.sqrt(max(len(self._values), 1))

    @property
    def frames(self) -> int:
        """Number of frames that the value is the median of."""
        return len(self._values)

    @property
    def settled(self) -> bool:
        """Whether the value can be trusted."""
        return len(self._values) >= SETTLED_FRAMES and self.scatter_ns < 0.5 * self._refresh_ns

    def forget(self) -> None:
        """Forget all frames; the value stays until the next."""
        self._values.clear()
        self.scatter_ns = float("inf")

    def is_precise(self, found: Match) -> bool:
        """Whether a frame whose strips fit measures the delay, and does not merely bound it."""
        return found.plateau_ns <= PLATEAU_REFRESHES * self._refresh_ns

    def note(self, found: Match) -> None:
        """Take in a frame whose strips fit."""
        if self.is_precise(found):
            self._values.append(found.delay_ns)
        else:
            within = min(max(self.value_ns, found.low_ns), found.high_ns)
            if within == self.value_ns:
                return
            if not self._values:
                self.value_ns = within
                return
            self._values.append(within)
        # numpy's median takes ten times as long for so few
        self.value_ns = median(self._values)
        if len(self._values) > 1:
            deviation = 1.4826 * median(abs(value - self.value_ns) for value in self._values)
            self.scatter_ns = max(deviation, LEAST_SCATTER_NS)

    def for_frame(self, found: Match) -> float:
        """Delay of one frame, ns: its own and the running one, weighted by variance, within its bounds."""
        if not self.is_precise(found):
            return min(max(self.value_ns, found.low_ns), found.high_ns)
        own = 1 / max(found.sigma_ns, 1.0) ** 2
        running = 1 / self.scatter_ns**2 if self.settled else 0.0
        between = (own * found.delay_ns + running * self.value_ns) / (own + running)
        return min(max(between, found.low_ns), found.high_ns)


class DelayWatch:
    """Panel timing of every frame: the rig's, with the delay measured from the coded strips.

    The rig's delay is used until the first strips fit, the running one where a frame's strips are unreadable.
    """

    def __init__(self, reader: StripReader, timing: PanelTiming, refresh_hz: float) -> None:
        self._reader = reader
        self._timing = timing
        self._refresh_ns = 1e9 / refresh_hz
        self._misses = 0
        self.estimator = DelayEstimator(timing.latency_ns, self._refresh_ns)
        self.last: Match | None = None
        """What the last frame's strips say; None where they say nothing."""
        self.legible = False
        """Whether the last frame's strips could be read, whatever they say."""

    @property
    def timing(self) -> PanelTiming:
        """Timing with the running delay."""
        return replace(self._timing, latency_ns=self.estimator.value_ns)

    def timing_of(self, image: Image, frame: Frame, log: PresentationLog) -> PanelTiming | None:
        """Timing for the pairing of `frame`; None when its strips contradict the log and it must not be used.

        image: (rows, cols) grey levels of the frame.
        """
        estimator = self.estimator
        readings = self._reader.read(image)
        found = match(readings, log, frame, self._timing, self._span_ns())
        if found is not None and not found.fits and estimator.settled:
            further = match(readings, log, frame, self._timing, self._around_ns(LATE_REFRESHES))
            found = further if further is not None and further.fits else found
        self.legible, self.last = bool(readings), found
        if found is None:
            return self.timing
        if found.fits:
            self._misses = 0
            used_ns = estimator.for_frame(found)
            estimator.note(found)
            return replace(self._timing, latency_ns=used_ns)
        self._misses += 1
        if self._misses >= LOST_AFTER:
            self._misses = 0
            estimator.forget()
        return None if found.contradicts else self.timing

    def _span_ns(self) -> tuple[float, float]:
        if self.estimator.settled:
            return self._around_ns(SPAN_REFRESHES)
        low, high = FIRST_SPAN_REFRESHES
        return low * self._refresh_ns, high * self._refresh_ns

    def _around_ns(self, refreshes: float) -> tuple[float, float]:
        half = refreshes * self._refresh_ns
        return self.estimator.value_ns - half, self.estimator.value_ns + half
