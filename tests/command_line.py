"""A command run in this process as from the shell: exit code, standard output, standard error."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

import click
import pytest

from zeromethod.cli.main import commands, main


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


def run(*arguments: object, command: click.Command = commands) -> Outcome:
    """Run `zeromethod` with these arguments, or another command."""
    with (
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
        pytest.raises(SystemExit) as end,
    ):
        main([str(argument) for argument in arguments], command)
    return Outcome(int(end.value.code or 0), out.getvalue(), err.getvalue())
