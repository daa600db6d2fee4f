"""Who steps back leaves the others' priority as it was."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from zeromethod.priority import BEHIND, step_back


@pytest.mark.skipif(sys.platform != "linux", reason="niceness is a process's as a whole")
def test_a_thread_steps_back_alone() -> None:
    found: list[int] = []
    before = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def look() -> None:
        step_back()
        found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    # a process that is further back already stays there
    assert found == [max(BEHIND, before)]
    assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == before
