"""`zeromethod compile`: what else the first start on a new machine does."""

from __future__ import annotations

import click

from zeromethod.cli.compiling import say
from zeromethod.compiling import compile_ahead, kernels_of


@click.command("compile")
def compile_command() -> None:
    """Compile ahead what the other commands would compile when they are first used on a new machine.

    It takes half a minute on two quiet cores, and nothing where all is compiled already.
    """
    compile_ahead(kernels_of(), say)
    click.echo("compiled: all that the commands are known to need")
