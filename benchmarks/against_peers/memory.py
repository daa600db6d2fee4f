"""Peak memory of every method, in a process of its own: `python -m benchmarks.against_peers.memory SIZES`.

SIZES: JSON list of [rows, cols], rising. Prints JSON: MB by method and size: what the process's peak resident
size (getrusage) rose by while the method was set up and read once, its frames not counted. A peak shows
only once it passes the highest one so far; so memory is filled up to that mark first, with blocks that are
kept while the method runs. Good to about 0.3 MB where the allocator gives freed memory back at once, which
glibc does as `scaling.MEMORY_ENVIRONMENT` asks.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.against_peers.integration import INTEGRATORS
from benchmarks.against_peers.methods import CONTENDERS
from benchmarks.against_peers.scaling import REPEATED_PX, Job, Size, frames_of, integration_task
from zeromethod.thread_limits import limit_threads

BLOCK_BYTES = 2**18
MOST_BLOCKS = 2**14


def peak_bytes() -> int:
    """Highest resident size of this process so far. Raises ImportError where there is none."""
    import resource  # noqa: PLC0415 - not on every platform

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def peak_rise_mb(work: Callable[[], object]) -> float:
    """MB (1e6 bytes) that `work` raises this process's resident size by, at its highest."""
    start = peak_bytes()
    ballast: list[NDArray[np.float64]] = []
    while peak_bytes() <= start and len(ballast) < MOST_BLOCKS:
        ballast.append(np.ones(BLOCK_BYTES // 8))
    start = peak_bytes()
    work()
    risen = peak_bytes() - start
    ballast.clear()
    return risen / 1e6


def memory_mb(shapes: list[Size]) -> dict[str, list[float]]:
    """MB by method name, one per (rows, cols).

    In the order of what they take at a small size, which also loads all code: so there is least to fill up.
    """
    rises = {name: peak_rise_mb(job(REPEATED_PX)) for name, job in JOBS.items()}
    found: dict[str, list[float]] = {name: [] for name in JOBS}
    for shape in shapes:
        for name in sorted(JOBS, key=lambda name: rises[name]):
            found[name].append(peak_rise_mb(JOBS[name](shape)))
    return found


def _displacement(name: str) -> Callable[[Size], Job]:
    def job(shape: Size) -> Job:
        frames = frames_of(CONTENDERS[name](REPEATED_PX), shape)
        return lambda: CONTENDERS[name](shape).read(frames)

    return job


def _integration(name: str) -> Callable[[Size], Job]:
    def job(shape: Size) -> Job:
        task = integration_task(shape)
        return lambda: INTEGRATORS[name](task)(task.slope)

    return job


JOBS = {name: _displacement(name) for name in CONTENDERS} | {name: _integration(name) for name in INTEGRATORS}


def main() -> None:
    """Measure the sizes given and write what was found to standard output."""
    limit_threads()
    shapes: list[Size] = [(rows, cols) for rows, cols in json.loads(sys.argv[1])]
    sys.stdout.write(json.dumps(memory_mb(shapes)) + "\n")


if __name__ == "__main__":
    main()
