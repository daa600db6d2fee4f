"""Python's garbage collection, paused while a live loop deals with a frame."""

from __future__ import annotations

import gc
import sys

SWITCH_S = 0.0005
"""How long another thread may go on computing once the loop wants to; Python's own default is 5 ms."""

COLLECTED_ABOVE = 20_000
"""How many objects made since the last collection make the next one due."""


class PausedGC:
    """A context in which garbage is collected only when `idle` is called, and threads switch quickly.

    Objects that exist at its start are not examined again, so that a collection takes well under 1 ms.
    """

    def __enter__(self) -> PausedGC:
        self._collected = gc.isenabled()
        self._switch_s = sys.getswitchinterval()
        gc.collect()
        gc.freeze()
        gc.disable()
        sys.setswitchinterval(SWITCH_S)
        return self

    def idle(self) -> None:
        """Collect if that is due; to be called when nothing waits for the loop."""
        if gc.get_count()[0] > COLLECTED_ABOVE:
            gc.collect(1)

    def __exit__(self, *exception: object) -> None:
        gc.unfreeze()
        if self._collected:
            gc.enable()
        sys.setswitchinterval(self._switch_s)
