"""One run carried out: a task in, one row of figures out, whatever happens."""

from __future__ import annotations

import os
import socket
import threading
import time
from typing import Any

import numpy as np

from zeromethod.errors import InputError, MeasurementError
from zeromethod.study.procedures import procedure
from zeromethod.study.task import WHOLE_LIMIT, Message, Task
from zeromethod.thread_limits import limit_threads

_ONE_AT_A_TIME = threading.Lock()
"""Threads of one process must not run side by side: OpenGL contexts and compiled code are one thread's."""

_LONGEST = 300

QUIET = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "LP_NUM_THREADS": "1",
}
"""One thread for each library, Mesa's software renderer included: the processes share the cores."""


def carry_out(message: Message) -> Message:
    """Outcome of a task: {"run", "seed", "figures" or None, "failure" or None, "seconds", "worker"}.

    Never raises: a run that fails is a row that says why.
    """
    with _ONE_AT_A_TIME:
        started = time.perf_counter()
        figures, failure = None, None
        try:
            figures = _figures(message)
        except (InputError, MeasurementError) as error:
            failure = str(error)
        except Exception as error:  # whatever it is, the other runs go on
            failure = f"{type(error).__name__}: {error}"
        return {
            "run": message["run"],
            "seed": message["seed"],
            "figures": figures,
            "failure": failure and " ".join(failure.split())[:_LONGEST],
            "seconds": time.perf_counter() - started,
            "worker": {"pid": os.getpid(), "host": socket.gethostname()},
        }


def _figures(message: Message) -> dict[str, Any]:
    os.environ.setdefault("LP_NUM_THREADS", QUIET["LP_NUM_THREADS"])
    limit_threads()
    found = procedure(message["procedure"]).carry_out(Task.of(message))
    return {name: plain(found.get(name)) for name in message["metrics"]}


def plain(value: Any) -> Any:
    """Value as JSON and a table have it; None for what is not a finite number."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and abs(value) >= WHOLE_LIMIT:
        value = float(value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return str(value)
