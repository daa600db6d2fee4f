"""What the guide to the real bench quotes is what the program says."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from commands import typed

from zeromethod import Event, State, load_rig
from zeromethod.calibration import Priors, describe
from zeromethod.cli.calibrate import calibrate_command
from zeromethod.cli.calibrate_weight import weight_command
from zeromethod.cli.check import check_command
from zeromethod.cli.devices import devices_command
from zeromethod.cli.init import init_command
from zeromethod.cli.run import run_command
from zeromethod.cli.virtual_bench import virtual_bench_command

ROOT = Path(__file__).parent.parent
GUIDE = (ROOT / "docs" / "bench.md").read_text()
SOURCE = "\n".join(path.read_text() for path in sorted((ROOT / "zeromethod").rglob("*.py")))
SPOKEN = re.sub(r'"\s*\n\s*f?"', "", SOURCE)
"""The package's text with its broken strings joined."""


def said() -> list[str]:
    """Messages in the guide's tables."""
    rows = [line for line in GUIDE.splitlines() if line.startswith("| ")]
    return sorted({quoted for row in rows for quoted in re.findall(r'"([^"]{4,})"', row)})


def test_messages_are_quoted() -> None:
    assert len(said()) > 40


@pytest.mark.parametrize("message", said())
def test_a_quoted_message_is_in_the_program(message: str) -> None:
    parts = [
        part
        for part in re.split(r"\.\.\.|: 5:|\b\d+ s\b|attempt 1, for 60 s more|['()]", message)
        if part.strip(" ,:;")
    ]
    assert parts
    for part in parts:
        assert part.strip(" ,:;") in SPOKEN, part


@pytest.mark.parametrize("name", [str(state) for state in State] + [str(event) for event in Event])
def test_every_state_and_event_is_explained(name: str) -> None:
    assert name in GUIDE


def test_every_option_in_the_guide_exists() -> None:
    commands = (
        devices_command,
        run_command,
        init_command,
        calibrate_command,
        weight_command,
        check_command,
        virtual_bench_command,
    )
    options = {name for command in commands for p in command.params for name in (*p.opts, *p.secondary_opts)}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", GUIDE)) <= options


def test_init_as_the_guide_types_it_makes_a_bench_off_by_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (line,) = re.findall(r"^zeromethod init (my\.toml --from virtual .*)$", GUIDE, re.MULTILINE)
    assert typed(init_command, *shlex.split(line)).exit_code == 0
    rig, true = load_rig("my.toml"), load_rig("virtual")
    assert (rig.prism.pattern_angle_deg, true.prism.pattern_angle_deg) == (50.2, 50.0)
    # as the guide says; what is set by hand as well would be there twice
    assert (rig.display.rise_s, rig.display.scanout_s) == (0.0, 0.0)
    off, sigma = Priors.of(rig), dict(zip(Priors.of(rig).names, Priors.of(rig).sigma, strict=True))
    exact = describe(true)
    for name, value in zip(off.names, off.mean, strict=True):
        # caliper errors, as stated: none beyond two sigma
        assert abs(value - exact[name]) < 2.0 * sigma[name], name


def test_every_file_that_the_guide_links_to_exists() -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", GUIDE)
    assert links
    for link in links:
        assert (ROOT / "docs" / link).exists(), link
