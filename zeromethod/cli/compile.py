"""`zeromethod compile`: what else the first starts on a new machine do."""

from __future__ import annotations

import click

from zeromethod.compiling import all_modules, compile_ahead


@click.command("compile")
def compile_command() -> None:
    """Compile ahead what the commands would compile when each is first used on a new machine.

    Nothing is done where all is compiled already.
    """
    compile_ahead(all_modules(), lambda words: click.echo(words, err=True))
    click.echo("compiled: all functions")
