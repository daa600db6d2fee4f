"""`zeromethod report` as a person meets it: a page beside the recording, refusals, the tail."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from recorded_run import recorded

from zeromethod.cli.main import main


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recorded") / "press é.h5", 0.2)


def outcome(*arguments: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(["report", *(str(argument) for argument in arguments)])
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


def test_the_page_lies_beside_the_recording(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(shutil.copy(recording, tmp_path))
    summary = tmp_path / "figures.json"
    code, out, err = outcome(path, "--summary", summary, capsys=capsys)
    page = path.with_suffix(".html")
    assert (code, err) == (0, "")
    assert out == f"written: {page}\n"
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert f"zeromethod replay &#39;{path}&#39;" in page.read_text(encoding="utf-8")
    figures = json.loads(summary.read_text())
    # 0.2 s at 60 frames per second
    assert figures["frames"] == pytest.approx(12, abs=1)
    assert figures["report"] == str(page)
    assert figures["damaged"] == {}


def test_the_page_goes_where_it_is_asked_to(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outcome(recording, "--output", tmp_path / "a.html", capsys=capsys)[0] == 0
    assert (tmp_path / "a.html").stat().st_size > 10_000
    assert not recording.with_suffix(".html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("missing.h5",), "missing.h5: not there"),
        (("folder.h5",), "folder.h5: is a folder; give a recording (HDF5)"),
        (("folder.h5", "--follow"), "folder.h5: is a folder; give a recording (HDF5)"),
        (("notes.h5",), "notes.h5: cannot be read as a recording"),
        (("notes.h5", "--output", "page.pdf"), "--output: page.pdf: the file name must end in .html"),
        (("notes.h5", "--follow", "--output", "a.html"), "--follow and --output"),
        (("notes.h5", "--follow"), "notes.h5: cannot be read as a recording"),
        (("nowhere/run.h5", "--follow"), "does not exist"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    arguments: tuple[str, ...],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.h5").mkdir()
    Path("notes.h5").write_text("not HDF5")
    os.utime("notes.h5", (time.time() - 60,) * 2)
    code, out, err = outcome(*arguments, capsys=capsys)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_following_a_finished_recording_tells_how_it_ended(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = outcome("--follow", recording, capsys=capsys)
    assert code == 0
    assert "peak" in out
    assert out.endswith("recording ended\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_wait_for_a_recording(number: signal.Signals, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "zeromethod", "report", "--follow", "later.h5"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting for later.h5\n"
        process.send_signal(number)
        _, told = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert told.strip() == ""
