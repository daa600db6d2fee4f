"""`zeromethod report` as a person meets it: a page next to the recording, the tail."""

import json
import shutil
import signal
from pathlib import Path

import pytest
from command_line import run, start
from recorded_run import recorded


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recorded") / "press é.h5", 0.2)


def test_the_page_lies_next_to_the_recording(recording, tmp_path):
    path = Path(shutil.copy(recording, tmp_path))
    summary = tmp_path / "figures.json"
    code, out, err = run("report", path, "--summary", summary)
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


def test_the_page_goes_where_it_is_asked_to(recording, tmp_path):
    assert run("report", recording, "--output", tmp_path / "a.html")[0] == 0
    assert (tmp_path / "a.html").stat().st_size > 10_000
    assert not recording.with_suffix(".html").exists()


def test_following_a_finished_recording_shows_how_it_ended(recording):
    code, out, _ = run("report", "--follow", recording)
    assert code == 0
    assert "peak" in out
    assert out.endswith("recording ended\n")


def test_a_signal_ends_the_wait_for_a_recording(tmp_path):
    process = start("report --follow later.h5", cwd=tmp_path)
    try:
        assert process.stdout.readline() == "waiting for later.h5\n"
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert err.strip() == "interrupted"
