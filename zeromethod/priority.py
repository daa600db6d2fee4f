"""Who has a core first when there are not enough."""

from __future__ import annotations

import contextlib
import os
import sys

BEHIND = 10
"""Niceness of processes that must not take a core from the loop. Reading may fall behind, and then reads the
newest; recording has seconds' worth of memory to wait in."""


def step_back() -> None:
    """Let the calling process have less of a core, where the loop wants it.

    To be called in its main thread, before it has others: Linux counts niceness per thread (and, with
    autogroup, within a session); elsewhere nothing changes. Not for threads beside the loop: one that is kept
    from a core while it has the interpreter's lock keeps the loop waiting, too.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, BEHIND)
