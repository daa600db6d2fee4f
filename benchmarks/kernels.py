"""Why each compiled function is compiled: what it takes a frame, and about what numpy would take.

The packaged rig's default scenario is run once, and every call of a compiled function is timed. numpy's time
is estimated, not that of a second version of the code: one elementary operation, which is timed, on the
largest array given, for each arithmetic operation, comparison and call that is written in the function.
So branches and coarser lattices count as if every node took them, and a recursion, which numpy cannot
do at once, as if it could.

A function is worth its compiling if it saves over 0.3 ms a frame; of others it says so.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
import time
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.kernels import Kernel
from zeromethod.rig.load import load_rig
from zeromethod.session.session import Session
from zeromethod.view.progress import progress

WORTH_MS = 0.3
FRAMES, QUICK_FRAMES = 159, 60
_TIMED = 20


@dataclass
class Calls:
    """Calls of one function: how many, how long in all, and the largest array given, elements."""

    count: int = 0
    seconds: float = 0.0
    largest: int = 1


def operations(function: Any) -> int:
    """Arithmetic operations, comparisons and calls that are written in a function and its compiled pieces."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    count = 0
    for node in ast.walk(tree):
        count += isinstance(node, ast.BinOp | ast.Compare | ast.Call)
        if isinstance(node, ast.Name):
            of = function.__globals__.get(node.id)
            count += operations(of.py_func) if isinstance(of, Dispatcher) else 0
    return count


def elementary_s(size: int) -> float:
    """Time of one elementary operation of numpy on two arrays of this size: the shortest of some."""
    a, out = np.ones(size), np.empty(size)
    taken = []
    for _ in range(_TIMED):
        began = time.perf_counter()
        np.multiply(a, a, out=out)
        taken.append(time.perf_counter() - began)
    return min(taken)


def calls_of_run(frames: int) -> dict[Kernel, Calls]:
    """Every compiled function's calls in so many frames of the default scenario."""
    calls: dict[Kernel, Calls] = defaultdict(Calls)
    call = Kernel.__call__

    def timed(kernel: Kernel, *arguments: Any) -> Any:
        began = time.perf_counter()
        try:
            return call(kernel, *arguments)
        finally:
            of = calls[kernel]
            of.count, of.seconds = of.count + 1, of.seconds + time.perf_counter() - began
            of.largest = max(of.largest, *(one.size for one in arguments if isinstance(one, np.ndarray)))

    with Session(load_rig("simulated")) as session, progress(frames, "frames") as advance:
        Kernel.__call__ = timed  # type: ignore[method-assign, assignment]
        try:
            for _ in session.run(frames=frames):
                advance()
        finally:
            Kernel.__call__ = call  # type: ignore[method-assign]
    return calls


def report(frames: int) -> Report:
    """Compiled functions by what they save, and how many do not."""
    calls = calls_of_run(frames)
    rows, data, vain = [], {}, 0
    for kernel, of in calls.items():
        name = f"{kernel.__module__.removeprefix('zeromethod.')}.{kernel.__name__}"
        compiled_ms = 1e3 * of.seconds / frames
        numpy_ms = 1e3 * of.count * operations(kernel.py_func) * elementary_s(of.largest) / frames
        saved_ms = numpy_ms - compiled_ms
        vain += saved_ms < WORTH_MS
        data[name] = {"calls": of.count / frames, "compiled_ms": compiled_ms, "numpy_ms": numpy_ms}
        words = "" if saved_ms >= WORTH_MS else "little saved, or a recursion"
        rows.append(
            (saved_ms, (name, f"{of.count / frames:.2f}", f"{compiled_ms:.3f}", f"{numpy_ms:.3f}", words))
        )
    rows.sort(reverse=True)
    whole = sum(of.seconds for of in calls.values())
    figures = [
        Figure("compiled functions that the default scenario calls", f"{len(calls)}"),
        Figure("of these, with savings that the estimate does not show", f"{vain}"),
        Figure("time in compiled functions", f"{1e3 * whole / frames:.2f} ms a frame"),
    ]
    head = ("function", "calls a frame", "compiled, ms", "numpy about, ms", "")
    return Report("Compiled functions", figures, [head, *(row for _, row in rows)], {"functions": data})


@benchmark("kernels", __doc__)
def command(quick: bool) -> Report:
    return report(QUICK_FRAMES if quick else FRAMES)


if __name__ == "__main__":
    start(command)
