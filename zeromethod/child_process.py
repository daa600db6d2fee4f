"""Python processes that work for the one that starts them, and what they do at their start."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from typing import Any, BinaryIO

NICENESS = 10
"""Niceness of processes that must not take a core from the loop. Reading may fall behind, and then reads the
newest; recording has seconds' worth of memory to wait in."""

_PROGRAM = "import sys, json; sys.path[:] = json.loads(sys.argv.pop(1)); from {} import main; main()"


def start_process(module: str, *arguments: str, **streams: Any) -> subprocess.Popen[bytes]:
    """Start `module.main()` in a process that imports what this one would. Raises OSError.

    arguments: its `sys.argv[1:]`. streams: as of `subprocess.Popen`. It is in a process group of its own:
    Ctrl-C in the terminal ends the run, which then ends the processes that work for it.
    """
    program = [sys.executable, "-c", _PROGRAM.format(module), json.dumps(sys.path), *arguments]
    return subprocess.Popen(program, process_group=0, **streams)


def ignore_signals() -> None:
    """Ignore the signals that are meant for the run, whose end ends this process; to be called in it."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def take_output() -> BinaryIO:
    """Take standard output for answers alone: what a library prints goes to standard error from now on."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers


def lower_priority() -> None:
    """Give the calling process less of a core where the loop needs it.

    To be called in its main thread, before it has others: Linux counts niceness per thread (and, with
    autogroup, within a session). Not for threads of the loop's process: one that
    waits for a core while it has the interpreter's lock keeps the loop waiting, too.
    """
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
