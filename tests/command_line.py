"""A command run as from the shell: exit code, standard output, standard error."""

import io
import shlex
import subprocess
import sys
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest

from zeromethod.cli.main import commands, main

Word = str | Path | float
"""A string may be several arguments, split as a shell does; a path is one."""


_BUSY = ("compiling, once", "starting: ")
"""Lines that come in between where nothing was compiled before or the machine is slow."""


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


def run(*words: Word, command: click.Command = commands, name: str = "zeromethod") -> Outcome:
    """Run `zeromethod`, or another command, in this process."""
    with (
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
        pytest.raises(SystemExit) as end,
    ):
        main(split(words), command, name)
    said = [line for line in err.getvalue().splitlines(keepends=True) if not line.startswith(_BUSY)]
    return Outcome(int(end.value.code or 0), out.getvalue(), "".join(said))


def split(words: Iterable[Word]) -> list[str]:
    return [one for word in words for one in (shlex.split(word) if isinstance(word, str) else [str(word)])]


def start(*words: Word, **options: Any) -> subprocess.Popen[str]:
    """Start `zeromethod` in a process of its own, which the caller ends."""
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-m", "zeromethod", *split(words)], **(pipes | options))
