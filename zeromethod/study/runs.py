"""One run carried out: a task in, one outcome out, whatever happens."""

from __future__ import annotations

import importlib
import os
import socket
import sys
import threading
import time
from typing import Any

import numpy as np

from zeromethod.errors import InputError, MeasurementError
from zeromethod.rig.refusal import shown
from zeromethod.study.task import Procedure, Task
from zeromethod.thread_limits import limit_threads

PROCEDURES = {
    "run": "zeromethod.study.closed_loop:CLOSED_LOOP",
    "averaging": "zeromethod.study.closed_loop:AVERAGING",
    "design": "zeromethod.study.geometry:DESIGN",
    "depth_error": "zeromethod.study.geometry:DEPTH_ERROR",
    "from_warps": "zeromethod.study.from_warps:FROM_WARPS",
}
"""Where the packaged ones are: a worker process loads the one that it carries out."""

Outcome = dict[str, Any]
"""run, seed, figures or None, failure or None, seconds, worker: as JSON has it."""

ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "LP_NUM_THREADS": "1",
}
"""One thread for each library, Mesa's software renderer included: the processes share the cores."""

WHOLE_LIMIT = 1 << 63
"""Whole numbers from here on do not fit a column of the results."""

_LONGEST = 300

_ONE_AT_A_TIME = threading.Lock()
"""Runs in threads of one process must not overlap: OpenGL contexts and compiled code are one thread's."""


def procedure(name: str) -> Procedure:
    """Procedure by name, or by `package.module:NAME` (the working directory is searched too).

    Raises InputError, one line, where there is none.
    """
    module, _, attribute = PROCEDURES.get(name, name).partition(":")
    allowed = f"one of {', '.join(PROCEDURES)}, or package.module:NAME of a Procedure"
    if not (module and attribute):
        raise InputError(f"procedure: {shown(name)}: {allowed}")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"procedure: {shown(name)}: {error}: {allowed}") from None
    if not isinstance(found, Procedure):
        raise InputError(f"procedure: {shown(name)}: a {type(found).__name__}: {allowed}")
    return found


def carry_out(task: Task) -> Outcome:
    """Outcome of a task. Never raises: a run that fails is a row that says why."""
    with _ONE_AT_A_TIME:
        started = time.perf_counter()
        figures, failure = None, None
        try:
            os.environ.setdefault("LP_NUM_THREADS", ONE_THREAD["LP_NUM_THREADS"])
            chosen = procedure(task.procedure)
            limit_threads()
            found = chosen.carry_out(task)
            figures = {name: plain(found.get(name)) for name in task.metrics}
        except (InputError, MeasurementError) as error:
            failure = str(error)
        except Exception as error:  # whatever it is, the other runs go on
            failure = f"{type(error).__name__}: {error}"
        return failed(task, failure) | {
            "figures": figures,
            "seconds": time.perf_counter() - started,
            "worker": {"pid": os.getpid(), "host": socket.gethostname()},
        }


def failed(task: Task, why: str | None) -> Outcome:
    """Outcome of a run without figures."""
    return {
        "run": task.run,
        "seed": task.seed,
        "figures": None,
        "failure": why and " ".join(why.split())[:_LONGEST],
        "seconds": None,
        "worker": None,
    }


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
