"""Processor time and memory of a live run by thread and process, as the system counts them."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from pathlib import Path


def _spent_ms(of: str) -> float:
    """Processor time of a thread or of a process's first one, ms; NaN once it is gone."""
    try:
        return 1e-6 * int(Path(f"/proc/{of}/schedstat").read_text(encoding="ascii").split()[0])
    except (OSError, ValueError, IndexError):
        return float("nan")


def spent_ms(processes: Mapping[str, int]) -> dict[str, float]:
    """Processor time so far, ms, by name: of this process's threads, added where alike, and of processes.

    processes: their ids, by name; they compute in their first thread. Threads that no Python knows, as those
    that draw in software, are "library threads".
    """
    named = {thread.native_id: thread.name for thread in threading.enumerate()}
    found = {name: _spent_ms(str(number)) for name, number in processes.items()}
    for number in os.listdir("/proc/self/task"):
        name = named.get(int(number), "library threads")
        found[name] = found.get(name, 0.0) + _spent_ms(f"self/task/{number}")
    return found


def memory_mb(process: int) -> float:
    """What a process alone holds, MB."""
    with open(f"/proc/{process}/smaps_rollup", encoding="ascii") as file:
        return next(float(line.split()[1]) for line in file if line.startswith("Private_Dirty")) / 1e3
