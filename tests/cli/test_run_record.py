"""`zeromethod run --record`: what a person sees of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from small_rigs import small_rig_file

from zeromethod.cli.main import main
from zeromethod.recording.recording import Recording


def outcome(*arguments: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(["run", *map(str, arguments)])
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


def test_a_recorded_run_is_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, path, summary = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5", tmp_path / "run.json"
    code, out, err = outcome(
        "--rig",
        rig,
        "--scenario",
        "step",
        "--frames",
        30,
        "--record",
        path,
        "--summary",
        summary,
        capsys=capsys,
    )
    assert (code, err) == (0, "")
    assert f"recorded in {path} (" in out
    assert "not kept" not in out
    figures = json.loads(summary.read_text())
    assert figures["recording"] == ""
    with Recording(path) as recording:
        assert recording.complete
        frames = recording.steps[recording.steps["frame_number"] >= 0]
        assert len(frames) == figures["frames"] == 30
        held = recording.steps["phase"] == b"hold"
        in_hold = recording.peaks["depth_mm"][
            np.isin(recording.peaks["step"], recording.steps["number"][held])
        ]
        # the summary's peak is the median over the nulled frames of the hold
        assert min(in_hold) <= figures["depth_peak_mm"] <= max(in_hold)
        assert recording.image(int(frames["number"][3])).shape == (256, 320)


def test_only_what_is_asked_for_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, path = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5"
    code, _, _ = outcome(
        "--rig", rig, "--scenario", "step", "--frames", 12, "--record", path, "--keep", "surface",
        "--every", 3, capsys=capsys,
    )  # fmt: skip
    assert code == 0
    with Recording(path) as recording:
        assert set(recording.kept) == {"surface"}
        assert recording.every == 3
        assert recording.image(4) is None
        read = [turn for turn in recording.steps["number"] if recording.surface(int(turn)) is not None]
        assert read
        assert all((turn - 1) % 3 == 0 for turn in read)


def test_the_tables_alone_may_be_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, path = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5"
    code, _, _ = outcome(
        "--rig", rig, "--scenario", "step", "--frames", 6, "--record", path, "--keep", "none", capsys=capsys
    )
    assert code == 0
    with Recording(path) as recording:
        assert set(recording.kept) == set()
        assert len(recording.steps) >= 6


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--keep", "frames"], "--keep: only with --record FILE.h5"),
        (["--every", 2], "--every: only with --record FILE.h5"),
        (["--compress"], "--compress: only with --record FILE.h5"),
        (["--record", "run.h5", "--keep", ""], "--keep: '': of frames, "),
        (["--record", "run.mp4"], "run.mp4: a recording's name ends in .h5 or .hdf5"),
        (["--record", "none/run.h5"], "does not exist"),
        (["--record", "run.h5", "--keep", "frames,depth"], "--keep: 'depth': of frames, "),
    ],
)
def test_what_cannot_be_recorded_is_told_in_one_line(
    arguments: list[object],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = outcome(*arguments, capsys=capsys)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert told in err
    assert not list(tmp_path.iterdir())


def test_a_recording_never_replaces_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.h5"
    path.write_text("mine")
    code, _, err = outcome("--record", path, capsys=capsys)
    assert code == 2
    assert "is there already" in err
    assert path.read_text() == "mine"
