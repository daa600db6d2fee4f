"""`zeromethod export` as a person meets it, on a recording of a simulated run."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh
from recorded_run import recorded

from zeromethod.cli.main import main

NAMES = ["a.npz", "a.tif", "a.ply", "a.stl", "a.csv", "a.mcap", "a.mp4"]


def outcome(*arguments: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(["export", *(str(argument) for argument in arguments)])
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the packaged simulated bench; its press of 0.2 mm comes down at 0.2 s."""
    return recorded(tmp_path_factory.mktemp("session") / "session.h5", 0.4)


def test_every_format_at_once_with_a_line_and_figures_of_each(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = tmp_path / "summary.json"
    outputs = [tmp_path / name for name in NAMES]
    code, out, err = outcome(session, *outputs, "--summary", summary, capsys=capsys)
    assert (code, err) == (0, "")
    files = json.loads(summary.read_text())["files"]
    for path, line, told in zip(outputs, out.splitlines(), files, strict=True):
        assert line.startswith(f"{path}: ")
        assert told["file"] == str(path)
        assert told["bytes"] == path.stat().st_size > 100
    assert " px of " in out.splitlines()[1]
    # Every file tells of the same press.
    with (tmp_path / "a.csv").open(newline="") as file:
        peaks = {line["time_s"]: line["depth_mm"] for line in csv.DictReader(file) if line["depth_mm"]}
    deepest_mm = float(list(peaks.values())[-1])
    assert deepest_mm == pytest.approx(0.2, rel=0.02)
    with np.load(tmp_path / "a.npz") as data:
        assert len(data["time_s"]) == len(peaks)
        assert np.nanmax(data["depth_mm"][-1]) == pytest.approx(deepest_mm, rel=0.02)
    maps = tifffile.imread(tmp_path / "a.tif")
    assert np.nanmax(maps[-1, 0]) == pytest.approx(deepest_mm, rel=0.02)
    for name in ("a.ply", "a.stl"):
        assert -trimesh.load_mesh(tmp_path / name).vertices[:, 2].min() == pytest.approx(deepest_mm, rel=0.02)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*NAMES, "summary.json"])


def test_format_names_the_file_whatever_its_suffix(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "track.txt").write_text("old")
    arguments = (session, tmp_path / "track.txt", "--format", "csv", "--from", 0.1, "--every", 2)
    code, out, _ = outcome(*arguments, capsys=capsys)
    assert code == 0
    lines = (tmp_path / "track.txt").read_text().splitlines()
    assert lines[0] == "time_s,depth_mm,depth_sigma_mm,x_mm,y_mm,state"
    assert f"{len(lines) - 1} times" in out
    assert float(lines[1].split(",")[0]) >= 0.1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("a.obj",), "OUT: {folder}/a.obj: the file name must end in .npz, .tif"),
        (("a.npz", "a.csv", "--format", "csv"), "--format: csv: for one OUT only"),
        (("a.npz", "a.npz"), "OUT: the same file is named twice"),
        (("a.csv", "--at", "1"), "--at: 1: only with a mesh (.ply, .stl)"),
        (("a.npz", "--pitch", "0.1"), "--pitch: 0.1: for a .tif only"),
        (("a.stl", "--every", "2"), "--every: 2: a mesh is of one time"),
        (("no/a.csv",), "OUT: {folder}/no/a.csv: the folder {folder}/no does not exist"),
        (("a.npz", "--from", "5"), "no surface recorded from 5 to "),
        (("a.npz", "--from", "0.3", "--to", "0.2"), "--from: 0.3: must not be after --to (0.2)"),
        (("a.tif", "--pitch", "100"), "--pitch: 100 mm: gives "),
        (("a.tif", "--pitch", "nan"), "--pitch: nan: a number above 0"),
        (("a.tif", "--pitch", "inf"), "--pitch: inf: a number above 0"),
        (("a.npz", "--from", "nan"), "--from: nan: seconds"),
        (("a.npz", "--to", "inf"), "--to: inf: seconds"),
        (("a.ply", "--at", "nan"), "--at: nan: seconds"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(
    arguments: tuple[str, ...],
    told: str,
    session: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    full = [tmp_path / word if "." in word and word[0].isalpha() else word for word in arguments]
    code, out, err = outcome(session, *full, capsys=capsys)
    assert (code, out) == (2, "")
    assert told.format(folder=tmp_path) in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_neither_another_file_nor_the_recording_itself_is_touched(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = session.read_bytes()
    code, _, err = outcome(session, session, "--format", "npz", capsys=capsys)
    assert (code, err) == (2, f"zeromethod: OUT: {session}: is the recording itself\n")
    assert session.read_bytes() == before
    code, _, err = outcome(tmp_path, tmp_path / "a.csv", capsys=capsys)
    assert (code, err) == (2, f"zeromethod: {tmp_path}: is a folder; give a recording (HDF5)\n")
    other = tmp_path / "other.h5"
    other.write_text("no recording")
    code, _, err = outcome(other, tmp_path / "a.csv", capsys=capsys)
    assert (code, err.count("\n")) == (2, 1)
    assert str(other) in err
