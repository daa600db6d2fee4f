"""Which part of a recording is replayed, and how fast."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from zeromethod.errors import InputError
from zeromethod.recording.recording import Recording


@dataclass(frozen=True)
class Window:
    """Part of a recording. from_ns, to_ns: on the run's clock, both included.

    start_ns: time of the recording's first frame. from_start: nothing is left out before.
    """

    start_ns: int
    from_ns: int
    to_ns: int
    from_start: bool

    @classmethod
    def of(cls, recording: Recording, from_s: float | None = None, to_s: float | None = None) -> Window:
        """Seconds from the recording's first frame; None: its beginning and its end.

        Raises InputError for a recording without frames and for times that leave nothing of it.
        """
        steps = recording.steps
        for option, value in (("--from", from_s), ("--to", to_s)):
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise InputError(f"{option}: {value}: seconds from the start of the recording, from 0 on")
        # the step that ends a session has no frame
        times = steps["time_ns"][steps["frame_number"] >= 0]
        if not times.size:
            raise InputError(f"{recording.path}: no frame came in it: nothing to replay")
        start_ns, end_ns = int(times.min()), int(times.max())
        from_ns = start_ns + round(1e9 * (from_s or 0.0))
        to_ns = end_ns if to_s is None else start_ns + round(1e9 * to_s)
        inside = (times >= from_ns) & (times <= to_ns)
        if not np.any(inside):
            last_s = 1e-9 * (end_ns - start_ns)
            asked = f"from {from_s or 0:g} s to {'the end' if to_s is None else f'{to_s:g} s'}"
            # the step that ended it came later
            length = f"the last frame came at {last_s:.3f} s, the recording lasts {recording.seconds:.3f} s"
            raise InputError(f"--from, --to: {asked}: nothing is there; {length}")
        return cls(start_ns, from_ns, to_ns, not from_s)

    def __contains__(self, time_ns: int) -> bool:
        return self.from_ns <= time_ns <= self.to_ns


class Pace:
    """Limits the speed of a replay. speed: 1 is that of the session, 2 twice as fast; None or 0: no limit."""

    def __init__(self, speed: float | None) -> None:
        self._speed = speed
        self._begun: tuple[float, int] | None = None

    def wait_for(self, time_ns: int) -> None:
        """Return when it is time for what happened at `time_ns` of the session; first call: now."""
        if not self._speed:
            return
        now_s = time.monotonic()
        if self._begun is None:
            self._begun = now_s, time_ns
        begun_s, first_ns = self._begun
        time.sleep(max(begun_s + 1e-9 * (time_ns - first_ns) / self._speed - now_s, 0.0))
