"""A command run in this process as from the shell: exit code, standard output, standard error."""

from __future__ import annotations

import io
import shlex
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import click
import pytest

from zeromethod.cli.main import commands, main


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


def run(*words: str | Path | float, command: click.Command = commands, name: str = "zeromethod") -> Outcome:
    """Run `zeromethod`, or another command; strings are split as a shell does, paths are not."""
    arguments = [
        one for word in words for one in (shlex.split(word) if isinstance(word, str) else [str(word)])
    ]
    with (
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
        pytest.raises(SystemExit) as end,
    ):
        main(arguments, command, name)
    return Outcome(int(end.value.code or 0), out.getvalue(), err.getvalue())
