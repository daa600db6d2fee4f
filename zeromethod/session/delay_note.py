"""The note on the delay round the loop, given to the operator once the delay is known."""

from __future__ import annotations

import numpy as np

from zeromethod.control.stability_margin import margin_words, stability_margin
from zeromethod.loop.loop import Loop
from zeromethod.rig.model import Rig
from zeromethod.session.result import RunResult

_DELAY_FRAMES = 24
"""Frames that timed the display before its delay is reported: of a few, the scatter is not known."""
_UNSTEADY = (
    "the delay is not steady: it scatters by {:.0f} ms from frame to frame: the display drops pictures, or "
    "the computer is too busy; stability is not known"
)


class DelayNote:
    """What the coded strips say of the delay, and what that leaves of stability; `result` keeps both."""

    def __init__(self, rig: Rig, loop: Loop, result: RunResult) -> None:
        self._rig, self._loop, self._result = rig, loop, result
        self._unsteady = False

    def take(self) -> tuple[str, ...]:
        """Take the note, which is shown once; () while there is none."""
        delay, horizon_s = self._loop.delay, self._loop.horizon_s
        if delay is None or delay.estimator.frames < _DELAY_FRAMES:
            return ()
        control, estimator = self._rig.control, delay.estimator
        if not estimator.settled:
            said, self._unsteady = self._unsteady, True
            return () if said else (_UNSTEADY.format(1e-6 * estimator.scatter_ns),)
        self._result.delay_ms = 1e-6 * estimator.value_ns
        if self._result.margin is not None or not np.isfinite(horizon_s):
            return ()
        margin = stability_margin(control, horizon_s * self._rig.camera.rate_hz)
        self._result.margin = margin
        return (
            f"delay {1e-6 * estimator.value_ns:.1f} ms, "
            f"± {1e-6 * estimator.scatter_ns:.1f} ms from frame to frame; "
            f"{margin.delay_frames:.1f} frames round the loop; {margin_words(margin, control)}",
        )
