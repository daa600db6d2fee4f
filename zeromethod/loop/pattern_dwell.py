"""The pattern's dwell: how many frames each picture stays on the LCD, by how well the loop locks.

Near null, pictures of two refreshes in one exposure do no harm: what was shown is their known mix. Where they
do (large motion, a timing that is not known), a picture that stands for two or three frames is seen alone by
one. That costs as many frames of delay, so it is done only while it pays:

    share of frames refused > RAISE_ABOVE over the last RAISE_FRAMES, or not nulled  -> a frame longer
    share < LOWER_BELOW over LOWER_FRAMES, all nulled                                -> a frame shorter

A shortening that has to be taken back soon doubles the frames of quiet until the next, up to 16-fold, so that
the period does not hunt. The same frames always lead to the same periods.
"""

from __future__ import annotations

from collections import deque

from zeromethod.loop.state import LOCK_RESIDUAL_PX

LONGEST_FRAMES = 3
"""A picture stays no longer than this."""

RAISE_FRAMES, RAISE_ABOVE = 24, 0.5
"""Single mixed frames clear themselves, as a command that stays is seen alone by the next frames."""

LOWER_FRAMES, LOWER_BELOW = 60, 0.1
"""Pictures stay shorter again after so many frames, of which less than this share was refused."""
LONGEST_WAIT = 16
"""Most times that those frames of quiet are multiplied by."""


class PatternDwell:
    """Decides when the next picture may be presented. frame_ns: the camera's frame time.

    timed: whether coded strips say what every frame saw. Then only frames that could not be used count: one
    that is not nulled shows that the mirror moves, and longer pictures would only add delay. Without them it
    may as well be the timing that is wrong.

    Call `note` for every frame measured or refused, and `presented` for every picture.
    """

    def __init__(self, frame_ns: float, timed: bool = False) -> None:
        self._frame_ns = frame_ns
        self._timed = timed
        self._recent: deque[bool] = deque(maxlen=RAISE_FRAMES)
        self._quiet = 0
        self._spoilt = 0
        self._wait = 1
        self._since_lowered: int | None = None
        self._presented_ns: int | None = None
        self.period_frames = 1

    def may_present(self, now_ns: int) -> bool:
        """Whether the picture shown has stayed for long enough."""
        if self.period_frames == 1 or self._presented_ns is None:
            return True
        # half a frame less, as frames and refreshes fall anywhere
        return now_ns - self._presented_ns >= (self.period_frames - 0.5) * self._frame_ns

    def presented(self, time_ns: int) -> None:
        """Note a picture presented at `time_ns`."""
        self._presented_ns = time_ns

    def note(self, unusable: bool, residual_rms_px: float) -> None:
        """Take in a frame: whether it was refused or mixed, and its residual (NaN where there is none)."""
        bad = unusable or not (self._timed or residual_rms_px < LOCK_RESIDUAL_PX)
        self._recent.append(bad)
        self._quiet += 1
        self._spoilt += bad
        if self._since_lowered is not None:
            self._since_lowered += 1
        if len(self._recent) == RAISE_FRAMES and sum(self._recent) > RAISE_ABOVE * RAISE_FRAMES:
            self._change(min(self.period_frames + 1, LONGEST_FRAMES))
        elif self._quiet >= LOWER_FRAMES * self._wait:
            quiet = self._spoilt < LOWER_BELOW * self._quiet
            self._quiet = self._spoilt = 0
            if quiet and self.period_frames > 1:
                self._change(self.period_frames - 1)

    def _change(self, period: int) -> None:
        if period > self.period_frames and self._since_lowered is not None:
            soon = self._since_lowered <= 2 * RAISE_FRAMES
            self._wait = min(2 * self._wait, LONGEST_WAIT) if soon else 1
            self._since_lowered = None
        if period < self.period_frames:
            self._since_lowered = 0
        self.period_frames = period
        self._recent.clear()
        self._quiet = self._spoilt = 0
