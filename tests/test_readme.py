"""What the README shows is what runs."""

import re
import shlex
from pathlib import Path

import click
import pytest
from test_documents_run import commands as shown_in

from benchmarks.rigs import small_rig
from zeromethod.cli.main import commands

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"


def test_the_python_example_runs_and_reads_the_press(capsys, monkeypatch):
    # with a fourth of the pixels on each axis, for speed
    monkeypatch.setattr("zeromethod.session.session.load_rig", lambda name: small_rig())
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    exec(compile(example, str(README), "exec"), {})
    state, depth_mm = capsys.readouterr().out.split()
    assert state == "locked"
    # The default press has come down to 0.2 mm by 0.5 s.
    assert float(depth_mm) == pytest.approx(0.2, rel=0.003)


def test_every_file_that_the_readme_links_to_exists():
    links = re.findall(r"\]\(([^)#:]+)\)", README.read_text())
    assert links
    for link in links:
        assert (README.parent / link).exists(), link


@pytest.mark.parametrize("document", [README, *sorted(ROOT.glob("docs/*.md"))], ids=lambda path: path.name)
def test_every_option_of_a_command_in_a_document_exists(document):
    context = click.Context(commands)
    for name, rest in re.findall(r"zeromethod ([a-z][a-z-]+)\b([^`\n#]*)", document.read_text()):
        command, first = commands.get_command(context, name), rest.split()[:1]
        if isinstance(command, click.Group) and first:
            command = command.get_command(context, first[0]) or command
        if command is not None:
            known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
            assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", rest)) <= known | {"--help"}, f"{name}{rest}"


@pytest.mark.parametrize("document", [README, *sorted(ROOT.glob("docs/*.md"))], ids=lambda path: path.name)
def test_every_command_in_a_document_is_one_that_the_program_takes(document):
    for line in shown_in(document):
        if not line.startswith("zeromethod"):
            continue
        command, words = commands, shlex.split(line)[1:]
        context = click.Context(commands)
        while isinstance(command, click.Group) and words and (one := command.get_command(context, words[0])):
            command, words = one, words[1:]
        given, left, _ = command.make_parser(click.Context(command)).parse_args(words)
        assert left == [], line
        for one in command.params:
            value = given.get(one.name)
            # files may not be there
            if value is not None and one.name and not isinstance(one.type, click.Path | click.File):
                one.type_cast_value(click.Context(command), value)
