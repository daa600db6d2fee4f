"""Entry point: sub-commands, and one place that turns failures into exit codes.

0 done, 1 the measurement failed (with the reason), 2 bad input (one line), 130 Ctrl-C, SIGTERM, SIGHUP.
"""

from __future__ import annotations

from zeromethod.cli.stopping import (
    INTERRUPTED,
    accept_ctrl_c,
    leave_quickly,
    quiet_imports,
    stopped_by_signals,
)

with quiet_imports():
    import importlib
    import os
    import sys
    import warnings
    from collections.abc import Sequence

    import click

    from zeromethod.errors import InputError, MeasurementError

_COMMANDS = {
    "run": "Close the loop: null the picture, read slope and depth.",
    "report": "A recording as one page; --follow shows it while it grows.",
    "replay": "Evaluate a recording again, or close its loop again.",
    "export": "A recording's depth, track, mesh, video for other programs.",
    "study": "Hundreds of runs, on every core or a cluster.",
    "virtual-bench": "Simulate prism and camera in real time, to practise.",
    "devices": "Monitors and cameras; identify, focus, delay, speed.",
    "init": "A commented rig file from what calipers give.",
    "calibrate": "From an unknown bench to millimetres.",
    "check": "Is the bench still as calibrated? Two minutes a day.",
    "design": "What a bench can do, from its rig file; curves, a drawing.",
    "measure": "Still images: displacement, and with --rig slope and depth.",
    "compile": "Once on a new machine: what the first start would do.",
    "reproduce": "The paper's figures and tables, next to this system's.",
}
"""Name and one line of help; `name` is `name_command` in `zeromethod/cli/name.py`."""


class _Commands(click.Group):
    """Sub-commands by name, each loaded when it is asked for: `run --help` needs no image correlation."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Every command, in the order in which a newcomer meets them."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Load one command."""
        if cmd_name not in _COMMANDS:
            return None
        name = cmd_name.replace("-", "_")
        _check_environment()
        with quiet_imports():
            module = importlib.import_module(f"zeromethod.cli.{name}")
        command: click.Command = getattr(module, f"{name}_command")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


def _check_environment() -> None:
    """Refuse a number of threads at which numba, when it is imported, gives up with a traceback."""
    given = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not given.strip().isdecimal() or int(given) < 1:
        raise InputError(f"NUMBA_NUM_THREADS: {given}: a whole number from 1 (in the environment)")


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="zeromethod", prog_name="zeromethod")
def commands() -> None:
    """Close the loop in deflectometry: null a deforming mirror's reflection, read its shape off the warp."""


def _show_warning(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    """Print a warning in one line, as the commands do."""
    kind = "" if issubclass(category, UserWarning) else f"{category.__name__}: "
    click.echo(f"! {kind}{' '.join(str(message).split())}", err=True)


def _drop_output() -> None:
    """Write what is left of the output, or nothing where it takes none, so that leaving does not fail."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _one_line(error: click.UsageError | InputError) -> str:
    """Message, click's own in the form of this program's: the option first, then what is wrong with it."""
    if isinstance(error, InputError):
        return str(error)
    if type(error) is click.BadParameter and error.param is not None:
        return f"{max(error.param.opts, key=len)}: {error.message}"
    return " ".join(error.format_message().split())


def main(
    arguments: Sequence[str] | None = None, command: click.Command = commands, name: str = "zeromethod"
) -> None:
    """Run a command called `name` and exit with its code; every failure is one line on standard error."""
    leave_quickly()
    accept_ctrl_c()
    warnings.showwarning = _show_warning
    try:
        with stopped_by_signals():
            code = command.main(args=arguments, prog_name=name, standalone_mode=False)
            sys.stdout.flush()
    except (click.exceptions.Abort, KeyboardInterrupt) as error:
        # click makes an Abort of what was raised, after an empty line
        click.echo(str(error.__cause__ or error) or "interrupted", err=True)
        code = INTERRUPTED
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = 0
    except (click.UsageError, InputError) as error:
        click.echo(f"zeromethod: {_one_line(error)}", err=True)
        code = 2
    except MeasurementError as error:
        click.echo(f"zeromethod: measurement failed: {error}", err=True)
        code = 1
    except SystemExit as error:
        if isinstance(error.__context__, BrokenPipeError):  # click's answer to it
            _drop_output()
            code = 0
        else:  # nothing here raises it: a driver, or a library under it
            words = f"a driver ended the program (SystemExit: {error})"
            click.echo(f"zeromethod: measurement failed: {words}", err=True)
            code = 1
    except BrokenPipeError:
        # the reader of the output has closed it
        _drop_output()
        code = 0
    except OSError as error:
        click.echo(f"zeromethod: cannot write: {error}", err=True)
        _drop_output()
        code = 1
    sys.exit(code or 0)
