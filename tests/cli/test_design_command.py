"""`zeromethod design` as a person meets it: tables, pictures, summary, warnings, refusals."""

import json
from pathlib import Path

import cv2
import pytest
from command_line import run
from small_rigs import BENCH_160, small_rig_file

from zeromethod.rig.save import save_values

QUICK = ("--press", "gaussian:3")


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """The simulated rig with an eighth of the camera's pixels on each axis."""
    return small_rig_file(tmp_path / "bench.toml", BENCH_160)


def test_tables_pictures_and_summary(rig_file, tmp_path):
    figure, summary = tmp_path / "design.png", tmp_path / "design.json"
    code, out, err = run(
        "design", rig_file, "--figure", figure, "--summary", summary, "--vary", "angle=45:55:2",
        "--vary", "pattern_layers[0].thickness_mm=0.5:1:2", *QUICK,
    )  # fmt: skip
    assert (code, err) == (0, "")
    for words in ("Margin to the critical angle", "Lever", "Deepest press", "largest stable gain", "assumed"):
        assert words in out
    assert "warning" not in out
    for name in ("design.png", "design-angle.png", "design-pattern_layers[0].thickness_mm.png"):
        assert cv2.imread(str(tmp_path / name)).shape[1] > 1000
    figures = json.loads(summary.read_text())
    assert figures["tir"]["critical_deg"] == pytest.approx(45.1715, abs=1e-4)
    assert [region["nodes"] > 0 for region in figures["regions"]] == [True] * 9
    assert figures["presses"][0]["press"] == "gaussian:3"
    # a press imitates a camera turned sideways best: both displace the mirror stiffly
    groups = {one["motions"]: one["share_under_press"] for one in figures["motion"]["groups"]}
    hidden = min(groups, key=lambda name: groups[name])
    assert hidden.startswith("camera turned sideways, or LCD slid along its columns")
    assert groups[hidden] < 0.05
    assert figures["delay"]["largest_gain"]["composition"] > 1
    assert figures["delay"]["worst_frames"] > figures["delay"]["mean_frames"] > 2
    assert [curve["key"] for curve in figures["vary"]] == ["angle", "pattern_layers[0].thickness_mm"]
    assert figures["vary"][0]["tir_least_margin_deg"][0] < 0 < figures["vary"][0]["tir_least_margin_deg"][1]


def test_45_degrees_with_silicone_is_warned_of():
    code, out, _ = run("design", "paper", *QUICK)
    assert code == 0
    words = " ".join(out.split())
    assert "warning: a prism of 45 deg with index 1.41 is below the critical angle" in words
    assert "total reflection begins at 45.17 deg" in words
    assert "with both faces at 45.2 deg the whole view is beyond it" in words


def test_a_real_bench_is_described_like_a_simulated_one(rig_file, tmp_path):
    real = tmp_path / "real.toml"
    values = {"display.driver": "window", "display.monitor": 1, "camera.driver": "pylon", "camera.gain": 2.0}
    save_values(rig_file, values, real)
    code, out, err = run("design", real, *QUICK, "--pupil", 8)
    assert (code, err) == (0, "")
    assert "8 mm (as given)" in out


def test_values_that_cannot_work_are_listed_with_their_reason(rig_file):
    code, out, _ = run("design", rig_file, "--vary", "distance=20:300:2", *QUICK)
    assert code == 0
    assert "distance 20: simulated: camera.position_mm" in " ".join(out.split())
