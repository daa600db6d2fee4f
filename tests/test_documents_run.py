"""Commands of README and docs that need no hardware run, and give the figures that stand next to them."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from zeromethod.cli.main import commands as commands_of_the_program

ROOT = Path(__file__).parent.parent
COMMANDS = commands_of_the_program.list_commands(click.Context(commands_of_the_program))
DOCUMENTS = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))]
HARDWARE = (
    *(
        "--display",
        "--camera ",
        "--identify",
        "--view",
        "--project",
        "--control ",
        "--follow",
        "virtual-bench",
        "--cluster",
        "--intrinsics",
    ),
    *(
        "make ",
        "pip ",
        "--show",
        "--diff",
        "HOST",
        "--monitor",
        "FOLDER",
        "/TIME/",
        "benchmarks.live_",
        "source ",
    ),
    *("board*.png", "frame*.png", "stack.npy"),
)
"""What needs a bench, a screen, a cluster, photographs, or is not for the shell of this test."""

ENDS_WITH = {"devices --speed": {0, 1}, "run --controller integrator --gain 0.3": {1}}
"""Exit codes other than 0: a computer that may be too slow, a controller that is, as README says."""

STATED = {
    "peak depth in the hold, worst frame": ("truth.depth_peak_error_percent", 1.0),
    "depth over all usable nodes in the hold": ("truth.depth_rms_error_um", 1e3),
    "peak depth while sliding at 10 mm/s, worst frame": ("truth_slide.depth_peak_error_percent", 1.0),
    "depth over all usable nodes while sliding": ("truth_slide.depth_rms_error_um", 1e3),
    "depth noise untouched: one frame / filtered": ("untouched.depth_rms_nm", 1.0),
    "usable nodes called valid": ("valid_share", 100.0),
}
"""Rows of README's table that `make run` gives: where they stand in its summary, and in which unit."""


def commands(document: Path) -> Iterator[str]:
    """Commands of a document's code blocks and indented lines, in order."""
    for line in document.read_text().splitlines():
        text = line.strip().partition("#")[0].strip().removeprefix(".venv/bin/")
        name = re.match(r"zeromethod ([a-z-]+)( [-\w./*]|$)|python -m benchmarks\.", text)
        if (
            name
            and name[1] in {None, *COMMANDS}
            and line.startswith((".venv", "zeromethod", "    zeromethod", "python"))
        ):
            yield re.sub(r"\s{2,}.*$", "", text)


def runnable(document: Path) -> list[str]:
    return [one for one in commands(document) if not any(word in f"{one} " for word in HARDWARE)]


WITH_COMMANDS = [one for one in DOCUMENTS if runnable(one)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a reader has who began with the README: a rig file, and the checkout's examples."""
    made = tmp_path_factory.mktemp("reader")
    for name in ("examples", "benchmarks", "shaders"):
        shutil.copytree(ROOT / name, made / name)
    assert done(made, "zeromethod init my.toml --no-ask").returncode == 0
    shutil.copytree(ROOT / "calibration", made / "calibration")
    shutil.copy(ROOT / "studies" / "gain-delay.toml", made / "my-study.toml")
    bench = (ROOT / "calibration" / "rigs" / "simulated.toml").read_text()
    (made / "lit.toml").write_text(f"{bench}\n[light]\nmains = 0.3\n")
    return made


def done(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    program, *words = shlex.split(command)
    start = [sys.executable, "-m", "zeromethod"] if program == "zeromethod" else [sys.executable]
    expanded = (
        [str(p.relative_to(folder)) for w in words for p in sorted(folder.glob(w))] if "*" in command else []
    )
    words = [one for w in words for one in (expanded if "*" in w else [w])]
    return subprocess.run([*start, *words], cwd=folder, capture_output=True, text=True, check=False)


def test_documents_have_commands_to_run():
    assert {one.name for one in WITH_COMMANDS} >= {
        "README.md",
        "design.md",
        "export.md",
        "measure.md",
        "replay.md",
    }


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("document", WITH_COMMANDS, ids=lambda path: path.name)
def test_every_command_runs(folder, document):
    for command in runnable(document):
        for made in (*folder.glob("*.h5"), *folder.glob("*.toml")):
            if made.name in command and ("--record" in command or " init " in command):
                made.unlink()
        result = done(folder, command)
        allowed = next((codes for words, codes in ENDS_WITH.items() if words in command), {0})
        assert result.returncode in allowed, f"{command}: {result.stderr[-2000:]}"


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_first_run_gives_the_figures_of_the_readme(tmp_path):
    assert done(tmp_path, "zeromethod run --summary run.json").returncode == 0
    figures = json.loads((tmp_path / "run.json").read_text())
    rows = dict(
        re.findall(r"^\| ([^|]+) \| ([^|]+) \|.*`make run` \|$", (ROOT / "README.md").read_text(), re.M)
    )
    assert set(rows) == set(STATED)
    for name, text in rows.items():
        key, unit = STATED[name]
        value = figures
        for part in key.split("."):
            value = value[part]
        stated = re.search(r"[-+]?\d+(\.\d+)?", text)
        # as printed: to its last digit, of which other graphics drivers may make one more or less
        digit = 10.0 ** -len((stated[1] or ".")[1:])
        assert unit * float(value) == pytest.approx(float(stated[0]), abs=1.5 * digit), name
