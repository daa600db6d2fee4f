"""Child processes: a lowered priority leaves that of other threads as it was."""

from __future__ import annotations

import os
import threading

from zeromethod.child_process import NICENESS, lower_priority


def test_a_thread_lowers_its_own_priority_only() -> None:
    found: list[int] = []
    before = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def look() -> None:
        lower_priority()
        found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    # a process that is further back already stays there
    assert found == [max(NICENESS, before)]
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == before
