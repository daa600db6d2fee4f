"""`zeromethod export` as a person meets it, on a recording of a simulated run."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh
from command_line import run
from recorded_run import recorded

NAMES = ["a.npz", "a.tif", "a.ply", "a.stl", "a.csv", "a.mcap", "a.mp4"]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the packaged simulated bench; its press of 0.2 mm comes down at 0.2 s."""
    return recorded(tmp_path_factory.mktemp("session") / "session.h5", 0.6)


def test_every_format_at_once_with_a_line_and_figures_of_each(session, tmp_path):
    summary = tmp_path / "summary.json"
    outputs = [tmp_path / name for name in NAMES]
    code, out, err = run("export", session, *outputs, "--summary", summary)
    assert (code, err) == (0, "")
    files = json.loads(summary.read_text())["files"]
    for path, line, found in zip(outputs, out.splitlines(), files, strict=True):
        assert line.startswith(f"{path}: ")
        assert found["file"] == str(path)
        assert found["bytes"] == path.stat().st_size > 100
    assert " px of " in out.splitlines()[1]
    # Every file holds the same press.
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


def test_format_names_the_file_whatever_its_suffix(session, tmp_path):
    (tmp_path / "track.txt").write_text("old")
    arguments = (session, tmp_path / "track.txt", "--format", "csv", "--from", 0.1, "--every", 2)
    code, out, _ = run("export", *arguments)
    assert code == 0
    lines = (tmp_path / "track.txt").read_text().splitlines()
    columns = (
        "time_s,depth_mm,depth_sigma_mm,x_mm,y_mm,x_sigma_mm,y_sigma_mm,total_force_n,sigma_total_force_n"
    )
    assert lines[0] == f"{columns},state,where,damaged"
    assert f"{len(lines) - 1} times" in out
    assert float(lines[1].split(",")[0]) >= 0.1
