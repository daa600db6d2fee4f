"""`zeromethod run` as a person meets it: what it writes, how it refuses, how it ends."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from command_line import run, start
from hanging import eventually
from small_rigs import BENCH_320, small_rig_file

from zeromethod import Recording
from zeromethod.simulation.camera import SimulatedCamera


def small_rig(folder: Path) -> Path:
    """The packaged rig seen by a camera of 320x256, as a file: quick to simulate."""
    return small_rig_file(folder / "small.toml")


def test_a_press_is_nulled_read_recorded_and_drawn(tmp_path):
    path, figure, summary = (tmp_path / name for name in ("run.h5", "run.png", "run.json"))
    line = "run --scenario step --frames 64 --rig"
    files = ("--record", path, "--figure", figure, "--summary", summary)
    code, out, err = run(line, small_rig(tmp_path), *files)
    assert (code, err) == (0, "")
    assert out.startswith("rig 'simulated' is simulated: real devices are named by --display and --camera\n")
    assert "peak depth read" in out
    assert "residual in the hold" in out
    assert f"recorded in {path} (" in out
    assert "not kept" not in out
    figures = json.loads(summary.read_text())
    assert figures["state"] == "locked"
    assert figures["truth"]["depth_peak_mm"] == pytest.approx(0.2, rel=1e-6)
    # A quarter of the camera's resolution: the bar of the full rig (0.3 %) widened by the node's size.
    assert figures["depth_peak_mm"] == pytest.approx(0.2, rel=0.01)
    # the worst frame is one before it was learned what presses
    truth = figures["truth"]
    assert abs(truth["depth_peak_error_percent"]) < 3 * truth["depth_peak_error_sigma_percent"]
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert figures["recording_trouble"] == ""
    with Recording(path) as recording:
        assert recording.complete
        frames = recording.steps[recording.steps["frame_number"] >= 0]
        assert len(frames) == figures["frames"] == 64
        held = recording.steps["number"][recording.steps["phase"] == b"hold"]
        in_hold = recording.peaks["depth_mm"][np.isin(recording.peaks["step"], held)]
        # the summary's peak is the median over the nulled frames of the hold
        assert min(in_hold) <= figures["depth_peak_mm"] <= max(in_hold)
        assert recording.image(int(frames["number"][3])).shape == (256, 320)


@pytest.mark.parametrize(("option", "row"), [("", "residual in the run"), ("--passive", "seen in the run,")])
def test_a_run_that_ends_before_its_hold_does_not_speak_of_one(option, row, tmp_path):
    code, out, _err = run("run --scenario step --frames 5 --rig", small_rig(tmp_path), option)
    assert code == 0
    assert row in out
    assert "hold" not in out


ANNOUNCING_CAMERA = """
from pathlib import Path
from zeromethod.simulation.camera import SimulatedCamera

class Camera(SimulatedCamera):
    def read(self, timeout_s):
        frame = super().read(timeout_s)
        if frame.number > 3:
            Path("frames").touch()
        return frame
"""


def test_ctrl_c_keeps_what_was_measured_and_exits_130(tmp_path):
    rig = small_rig(tmp_path)
    rig.write_text(
        rig.read_text().replace('[camera]\ndriver = "simulated"', '[camera]\ndriver = "lab:Camera"')
    )
    (tmp_path / "lab.py").write_text(ANNOUNCING_CAMERA)
    line = "run --scenario hold --seconds 1000 --summary run.json --rig"
    process = start(line, rig.name, cwd=tmp_path)
    eventually(lambda: (tmp_path / "frames").exists() or process.poll() is not None, 120)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    figures = json.loads((tmp_path / "run.json").read_text())
    assert figures["interrupted"] is True
    assert figures["frames"] > 0


def test_without_arguments_the_commands_are_listed():
    code, out, err = run()
    assert (code, err) == (0, "")
    assert "run" in out


def test_a_run_whose_bench_moved_ends_with_1_and_says_what_to_do(tmp_path):
    bump = {"moved_at_frame": 10, "camera_turned_deg": [0.021, 0.0, 0.0]}
    values = BENCH_320 | {f"simulation.faults.{key}": value for key, value in bump.items()}
    rig = small_rig_file(tmp_path / "bumped.toml", values)
    code, _, err = run("run", "--rig", rig, "--scenario", "none", "--frames", 24)
    assert code == 1
    assert "the bench moved by" in " ".join(err.split())
    assert "press z" in " ".join(err.split())


def test_a_camera_whose_exposure_stays_is_refused_where_it_is_to_follow_the_light(tmp_path, monkeypatch):
    monkeypatch.setattr(SimulatedCamera, "exposure_settable", False, raising=False)
    code, _, err = run("run --auto-exposure --frames 2 --rig", small_rig(tmp_path))
    assert code == 2
    words = "--auto-exposure: SimulatedCamera cannot change its exposure during a run: give --exposure\n"
    assert err.endswith(words)
