"""Commands as a person types them, and refusals on one line."""

from typing import Any

from click.testing import CliRunner, Result

from zeromethod.errors import InputError


def typed(command: Any, *arguments: object, answers: str | None = None) -> Result:
    """What a command does with these arguments, on a terminal of 160 columns."""
    return CliRunner(env={"COLUMNS": "160"}).invoke(command, [str(one) for one in arguments], input=answers)


def assert_refused(result: Result, words: str) -> None:
    """Refused as bad input, with these words on one line."""
    assert isinstance(result.exception, InputError), result.output
    assert words in str(result.exception)
    assert "\n" not in str(result.exception)
