"""Child processes: a lowered priority leaves that of other threads as it was."""

import os
import threading

from zeromethod.child_process import NICENESS, lower_priority
from zeromethod.worker import in_thread


def test_a_thread_lowers_its_own_priority_only():
    before = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def look() -> int:
        lower_priority()
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    found = in_thread("look", look).result(10)
    # a process that is further back already stays there
    assert found == max(NICENESS, before)
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == before
