"""Who has a core first when there are not enough."""

from __future__ import annotations

import contextlib
import os
import sys
import threading

BEHIND = 10
"""Niceness of what must not take a core from the loop."""


def step_back() -> None:
    """Let the calling thread have a core only where those of the loop leave one.

    Linux counts niceness per thread (and, with autogroup, within a session); elsewhere nothing changes.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), BEHIND)
