"""What the commands say on a new machine while functions are compiled."""

from __future__ import annotations

import click

from zeromethod.compiling import report_compiling


def say(words: str) -> None:
    """Say on standard error how far compiling is."""
    click.echo(words, err=True)


def say_compiling() -> None:
    """Say on standard error, from now on, when something must be compiled."""
    report_compiling(say, ahead=True)
