"""Where in a refresh exposures have lain: the clocks of camera and panel drift past each other."""

from __future__ import annotations

import numpy as np

PARTS = 32
"""Parts of a refresh that are distinguished: clocks that meet again within 32 looks move on in each."""


class ClockPhases:
    """Parts of a refresh in which mid-exposures fell.

    A camera of 59.95 Hz before a panel of 60 Hz takes 20 s to go through all of them: a measurement that
    needs exposures which share two pictures waits until they come.
    """

    def __init__(self, refresh_ns: float) -> None:
        self._refresh_ns = refresh_ns
        self._seen = np.zeros(PARTS, dtype=bool)
        self._known = 0

    def note(self, since_ns: int) -> None:
        """Take in a mid-exposure, `since_ns` after any presentation."""
        self._seen[int(since_ns / self._refresh_ns * PARTS) % PARTS] = True

    def moved_on(self) -> bool:
        """Whether new parts came since this was last asked."""
        before, self._known = self._known, int(np.count_nonzero(self._seen))
        return self._known > before
