"""Entry point: sub-commands, and one place that turns failures into exit codes.

0 done, 1 the measurement failed (with the reason), 2 bad input (one line), 130 Ctrl-C.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import click

from zeromethod.errors import InputError, MeasurementError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="zeromethod", prog_name="zeromethod")
def commands() -> None:
    """Close the loop in deflectometry: null a deforming mirror's reflection, read its shape off the warp."""


def _register() -> None:
    # Deferred so that `--help` and bad arguments answer without loading OpenGL and the compilers.
    from zeromethod.cli.run import run_command  # noqa: PLC0415

    commands.add_command(run_command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    try:
        _register()
        code = commands.main(args=arguments, prog_name="zeromethod", standalone_mode=False)
    except click.exceptions.Abort:
        code = 130
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = 0
    except click.UsageError as error:
        click.echo(f"zeromethod: {error.format_message()}".replace("\n", " "), err=True)
        code = 2
    except InputError as error:
        click.echo(f"zeromethod: {error}", err=True)
        code = 2
    except MeasurementError as error:
        click.echo(f"zeromethod: measurement failed: {error}", err=True)
        code = 1
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:
        # Whoever read the output has seen enough; nothing may be written on the way out either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:
        click.echo(f"zeromethod: cannot write: {error}", err=True)
        code = 1
    sys.exit(code or 0)
