"""`zeromethod replay` as a person meets it."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from recorded_run import recorded

from benchmarks.against_peers.open_loop import coarser
from zeromethod import Recording, load_rig


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of a small bench, pressed at once at 0.2 s."""
    rig = coarser(load_rig("simulated"), 8).model_copy(update={"scenario": "step"})
    return recorded(tmp_path_factory.mktemp("replay") / "session.h5", 0.45, rig=rig)


def test_replay_from_warps_reports_no_difference(session, tmp_path):
    summary, figure = tmp_path / "s.json", tmp_path / "f.png"
    code, out, err = run("replay", session, "--summary", summary, "--figure", figure)
    assert (code, err) == (0, "")
    assert "equal bit for bit" in out
    figures = json.loads(summary.read_text())
    assert (figures["mode"], figures["changed"], figures["equal"]) == ("from-warps", False, True)
    assert figures["readings"] == figures["readings_equal"] > 15
    assert figures["depth_difference_nm"]["largest"] == 0.0
    assert len(figures["peaks"]["time_s"]) == figures["readings"]
    assert figures["depth_difference_rms_nm"] == [0.0] * figures["readings"]
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_replay_says_once_that_what_holds_the_rubber_is_not_known(session):
    window = "--from", 0.1, "--to", 0.2
    code, _, err = run("replay", session, *window, "--set", "rubber={}")
    assert code == 0
    assert err.count("\n") == 1
    assert err.startswith("! rubber.support is not given: ")
    assert run("replay", session, *window, "--set", "rubber={}", "--set", "rubber.support=free")[2] == ""


def test_replay_from_frames_with_another_setting_reports_what_it_changes(session, tmp_path):
    summary = tmp_path / "s.json"
    line = "--mode from-frames --set camera.noise.read_grey=9 --from 0.1 --to 0.2"
    code, out, err = run("replay", session, line, "--summary", summary)
    assert (code, err) == (0, "")
    assert "sigma of a warp" in out
    figures = json.loads(summary.read_text())
    assert (figures["changed"], figures["equal"]) == (True, False)
    assert figures["settings"] == ["camera.noise.read_grey=9"]
    assert 5 <= figures["steps"] <= 7
    assert figures["sigma_lcd_px"]["replayed"] > figures["sigma_lcd_px"]["recorded"]


def test_the_loop_closed_again_is_compared_drawn_and_recorded(session, tmp_path):
    summary, figure, record = (tmp_path / name for name in ("s.json", "f.png", "again.h5"))
    files = ("--summary", summary, "--figure", figure, "--record", record)
    line = "--mode closed-loop --controller integrator --gain 0.2"
    code, out, _ = run("replay", session, line, *files)
    assert code == 0
    assert all(name in out for name in ("recorded", "simulated", "changed", "picture behind the mirror"))
    figures = json.loads(summary.read_text())
    sessions = figures["sessions"]
    assert list(sessions) == ["recorded", "simulated", "changed"]
    assert sessions["recorded"]["frames"] == sessions["simulated"]["frames"] > 20
    assert sessions["changed"]["residual_rms_px"] > sessions["simulated"]["residual_rms_px"]
    assert len(figures["curves"]["changed"]["residual_rms_px"]) == sessions["changed"]["frames"]
    assert figures["settings"] == ["control.gain=0.2", "control.controller=integrator"]
    assert figure.read_bytes().startswith(b"\x89PNG")
    with Recording(record) as again:
        assert again.rig.control.controller == "integrator"
        assert np.count_nonzero(again.steps["sensed"]) >= sessions["changed"]["frames"]


def test_an_unchanged_loop_is_compared_with_the_recorded_session_alone(session):
    code, out, _ = run("replay", session, "--mode", "closed-loop", "--to", "0.15")
    assert code == 0
    assert "simulated" in out
    assert "changed" not in out
