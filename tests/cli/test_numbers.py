"""Numbers of the command line, and that no two options of a command share a name."""

from collections import Counter
from collections.abc import Iterator

import click
import pytest

from zeromethod.cli.main import commands
from zeromethod.cli.numbers import Real, Whole


@pytest.mark.parametrize(
    ("kind", "text", "allowed"),
    [
        (Real(0, 1, min_open=True), "3", "3: a number above 0, at most 1"),
        (Real(0, 1, min_open=True), "nan", "nan: a number above 0, at most 1"),
        (Real(5, 85, min_open=True, max_open=True), "85", "85: a number above 5, below 85"),
        (Real(0.1, 100), "abc", "abc: a number from 0.1 to 100"),
        (Real(min=0), "inf", "inf: a number from 0"),
        (Real(), "-inf", "-inf: a number"),
        (Whole(min=1), "0", "0: a whole number from 1"),
        (Whole(16, 16384), "1280.5", "1280.5: a whole number from 16 to 16384"),
    ],
)
def test_what_is_not_in_the_range_is_refused_with_it(kind, text, allowed):
    with pytest.raises(click.BadParameter) as refused:
        kind.convert(text, None, None)
    assert refused.value.message == allowed


def all_commands(group: click.Group, before: str = "") -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        yield f"{before}{name}", command
        if isinstance(command, click.Group):
            yield from all_commands(command, f"{before}{name} ")


@pytest.mark.parametrize(
    ("name", "command"), [pytest.param(*one, id=one[0]) for one in all_commands(commands)]
)
def test_no_option_takes_the_place_of_another(name, command):
    twice = [key for key, count in Counter(one.name for one in command.params).items() if count > 1]
    assert not twice, name
