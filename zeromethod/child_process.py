"""Python processes that work beside the one that starts them, and what they need at their start."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import Any, BinaryIO

_PROGRAM = "import sys, json; sys.path[:] = json.loads(sys.argv.pop(1)); from {} import main; main()"


def start_beside(module: str, *arguments: str, **streams: Any) -> subprocess.Popen[bytes]:
    """Start `module.main()` in a process that imports what this one would. Raises OSError.

    arguments: its `sys.argv[1:]`. streams: as of `subprocess.Popen`. It stands in a group of its own: Ctrl-C
    in the terminal ends the run, which then ends what works for it.
    """
    program = [sys.executable, "-c", _PROGRAM.format(module), json.dumps(sys.path), *arguments]
    return subprocess.Popen(program, process_group=0, **streams)


def heed_run_only() -> None:
    """Let nothing but the end of the run's process end this one; to be called in it."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def take_output() -> BinaryIO:
    """Take standard output for answers alone: what a library prints goes to standard error from now on."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return answers
