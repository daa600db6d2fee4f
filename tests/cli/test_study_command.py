"""`zeromethod study` at the terminal: what it writes, says and ends with."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pyarrow.parquet
import pytest
from command_line import run, start
from hanging import eventually
from processes import has_ended

from zeromethod.study import workers
from zeromethod.study.runs import carry_out

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


def test_without_a_file_the_packaged_studies_are_listed():
    code, out, _ = run("study")
    assert code == 0
    names = ["calibration-budget", "fold-limit", "gain-delay", "noise-floor"]
    assert [line.split()[0] for line in out.splitlines()] == names


def test_table_picture_and_summary_are_written():
    study()
    code, out, _ = run("study mine.toml --workers 1 --summary s.json")
    assert code == 0
    assert "squares: 4 runs, 0 failed" in out
    assert pyarrow.parquet.read_table("study-mine/table.parquet")["square"].to_pylist() == [0, 1, 4, 9]
    assert Path("study-mine/figure.png").read_bytes().startswith(b"\x89PNG")
    summary = json.loads(Path("s.json").read_text())
    assert (summary["runs"], summary["failed"]) == (4, 0)
    code, out, _ = run("study mine.toml")
    assert code == 0
    assert "4 runs, 4 of them from before" in out
    # other settings in the same folder
    study("control.gain = 0.5")
    code, _, err = run("study mine.toml --workers 1")
    assert code == 2
    assert "--restart to begin again" in err


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs in this process: a worker of its own takes seconds to start."""
    monkeypatch.setattr(workers.Workers, "outcomes", lambda _, tasks: (carry_out(task) for task in tasks))


@pytest.mark.usefixtures("here")
def test_a_failed_run_is_reported_with_settings_and_seed():
    study("fails_at = 2")
    code, _, err = run("study mine.toml --output out --workers 1")
    assert code == 1
    seed = pyarrow.parquet.read_table("out/table.parquet")["seed"].to_pylist()[2]
    assert f"run 2, seed {seed}, x = 2: no 2" in err
    assert "1 of 4 runs failed" in err


def test_a_wrong_address_begins_nothing_and_forgets_nothing(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "_CONNECT_S", 1)
    study()
    nowhere = "study mine.toml --cluster tcp://127.0.0.1:9"
    code, _, err = run(nowhere)
    assert code == 2
    assert "--cluster: tcp://127.0.0.1:9: no Dask scheduler answers" in err
    assert not Path("study-mine").exists()
    assert run("study mine.toml --workers 1").code == 0
    assert run(nowhere, "--restart").code == 2
    # where nothing is left to do, the cluster of before is not needed
    code, out, _ = run(nowhere)
    assert code == 0
    assert "4 runs, 4 of them from before" in out


def test_a_killed_study_leaves_no_worker_and_goes_on():
    process = started("waits_at = 2")
    process.kill()
    process.communicate()
    done = [json.loads(line) for line in Path("study-mine/runs.jsonl").read_text().splitlines()[1:]]
    assert [one["run"] for one in done] == [0, 1]
    # the run that the worker is at takes ten minutes
    eventually(lambda: has_ended(done[0]["worker"]["pid"]))
    Path("mine.toml").write_text(f"limit_s = 3.0\n{Path('mine.toml').read_text()}")
    code, out, err = run("study mine.toml --workers 1")
    assert code == 1
    assert "4 runs, 2 of them from before, 1 failed" in out
    assert "x = 2: took longer than limit_s = 3 s" in err


def started(settings: str) -> subprocess.Popen[str]:
    """The study in a process of its own, once it waits."""
    study(settings, "mark = 'waiting'")
    process = start("study mine.toml --workers 1", start_new_session=True)
    try:
        eventually(Path("waiting").exists, 60)
    except BaseException:
        process.kill()
        raise
    return process


def test_a_stopped_study_ends_quickly_and_says_how_to_go_on():
    process = started("waits_at = 3")
    try:
        # to the workers as well, as a terminal does
        os.killpg(process.pid, signal.SIGINT)
        stopped_s = time.monotonic()
        err = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    # at once on a quiet machine; the waiting run itself takes ten minutes
    assert time.monotonic() - stopped_s < 60
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "3 of 4 runs are kept in study-mine; the same command goes on from there" in err
    assert len(Path("study-mine/runs.jsonl").read_text().splitlines()) == 4
