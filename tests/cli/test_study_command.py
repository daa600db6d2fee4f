"""`zeromethod study` at the terminal: what it writes, says and ends with."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
from processes import has_ended

from zeromethod.cli.main import main
from zeromethod.study import workers

OWN = Path(__file__).parents[1] / "study"
QUICK = """schema_version = 1
title = "squares"
procedure = "own_procedures:SQUARE"
[set]
{settings}
[grid]
x = [0, 1, 2, 3]
"""


@pytest.fixture(autouse=True)
def own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(OWN))
    monkeypatch.setenv("PYTHONPATH", str(OWN), prepend=os.pathsep)
    monkeypatch.chdir(tmp_path)


def study(*settings: str) -> None:
    Path("mine.toml").write_text(QUICK.format(settings="\n".join(settings)))


def code_of(*arguments: str) -> Any:
    with pytest.raises(SystemExit) as ended:
        main(["study", *arguments])
    return ended.value.code


def test_without_a_file_the_packaged_studies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of() == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == [
        "calibration-budget",
        "fold-limit",
        "gain-delay",
        "noise-floor",
    ]


def test_table_picture_and_summary_are_written(capsys: pytest.CaptureFixture[str]) -> None:
    study()
    assert code_of("mine.toml", "--summary", "s.json", "--workers", "1") == 0
    assert "squares: 4 runs, 0 failed" in capsys.readouterr().out
    assert pyarrow.parquet.read_table("study-mine/table.parquet")["square"].to_pylist() == [0, 1, 4, 9]
    assert Path("study-mine/figure.png").read_bytes().startswith(b"\x89PNG")
    summary = json.loads(Path("s.json").read_text())
    assert (summary["runs"], summary["failed"]) == (4, 0)
    assert code_of("mine.toml") == 0
    assert "4 runs, 4 of them from before" in capsys.readouterr().out


def test_a_failed_run_is_reported_with_settings_and_seed(capsys: pytest.CaptureFixture[str]) -> None:
    study("fails_at = 2")
    assert code_of("mine.toml", "--output", "out", "--workers", "1") == 1
    said = capsys.readouterr().err
    seed = pyarrow.parquet.read_table("out/table.parquet")["seed"].to_pylist()[2]
    assert f"run 2, seed {seed}, x = 2: no 2" in said
    assert "1 of 4 runs failed" in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.toml"], "none.toml: cannot be read: No such file or directory: a study file (TOML)"),
        (
            ["nothing"],
            "zeromethod: FILE: nothing: a study file (.toml), or one of the packaged calibration-budget, "
            "fold-limit, gain-delay, noise-floor",
        ),
        (
            ["mine.toml", "--retry-failed", "--restart"],
            "--retry-failed: not with --restart, which does every run",
        ),
        (
            ["mine.toml", "--cluster", "tcp://127.0.0.1:9", "--workers", "2"],
            "--workers: 2: not with --cluster",
        ),
        (["mine.toml", "--output", "mine.toml"], "--output"),
        (["mine.toml", "--summary", "a.txt"], "--summary: a.txt: the file name must end in .json"),
    ],
)
def test_bad_input_ends_with_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    study()
    assert code_of(*arguments) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1


def test_other_settings_in_the_folder_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    study()
    assert code_of("mine.toml", "--workers", "1") == 0
    study("control.gain = 0.5")
    assert code_of("mine.toml", "--workers", "1") == 2
    assert "--restart to begin again" in capsys.readouterr().err


def test_help_says_that_the_file_may_be_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert code_of("--help") == 0
    assert capsys.readouterr().out.splitlines()[0].endswith("[OPTIONS] [FILE]")


def test_a_wrong_address_begins_nothing_and_forgets_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "_CONNECT_S", 1)
    study()
    nowhere = ["mine.toml", "--cluster", "tcp://127.0.0.1:9"]
    assert code_of(*nowhere) == 2
    assert "--cluster: tcp://127.0.0.1:9: no Dask scheduler answers" in capsys.readouterr().err
    assert not Path("study-mine").exists()
    assert code_of("mine.toml", "--workers", "1") == 0
    assert code_of(*nowhere, "--restart") == 2
    # where nothing is left to do, the cluster of before is not needed
    assert code_of(*nowhere) == 0
    assert "4 runs, 4 of them from before" in capsys.readouterr().out


def test_a_killed_study_leaves_no_worker_and_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    study("waits_at = 2", "mark = 'waiting'")
    process = subprocess.Popen([sys.executable, "-m", "zeromethod", "study", "mine.toml", "--workers", "1"])
    try:
        wait_until(Path("waiting").exists, 60)
    finally:
        process.kill()
        process.wait()
    done = [json.loads(line) for line in Path("study-mine/runs.jsonl").read_text().splitlines()[1:]]
    assert [one["run"] for one in done] == [0, 1]
    # the run that the worker is at takes a minute
    wait_until(lambda: has_ended(done[0]["worker"]["pid"]), 20)
    Path("mine.toml").write_text(f"limit_s = 3.0\n{Path('mine.toml').read_text()}")
    assert code_of("mine.toml", "--workers", "1") == 1
    said = capsys.readouterr()
    assert "4 runs, 2 of them from before, 1 failed" in said.out
    assert "x = 2: took longer than limit_s = 3 s" in said.err


def wait_until(there: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_a_stopped_study_ends_quickly_and_says_how_to_go_on() -> None:
    study("waits_at = 3", "mark = 'waiting'")
    process = subprocess.Popen(
        [sys.executable, "-m", "zeromethod", "study", "mine.toml", "--workers", "1"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 60
        while not Path("waiting").exists() and time.monotonic() < until:
            time.sleep(0.05)
        # to the workers as well, as a terminal does
        os.killpg(process.pid, signal.SIGINT)
        started = time.monotonic()
        said = process.communicate(timeout=30)[1]
    finally:
        process.kill()
    # at once on a quiet machine; the waiting run itself takes a minute
    assert time.monotonic() - started < 20
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "3 of 4 runs are kept in study-mine; the same command goes on from there" in said
    assert len(Path("study-mine/runs.jsonl").read_text().splitlines()) == 4
