"""`run` on a bench whose rig file comes straight from calipers: never locked, never an unmarked depth."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from commands import assert_refused, typed
from commissioning.calibration import planted

from zeromethod import Recording, State
from zeromethod.cli.check import check_command
from zeromethod.cli.run import run_command


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def rig_file(folder: Path) -> Path:
    drivers = {
        f"{kind.lower()}.driver": f"commissioning.calibration.planted:Planted{kind}"
        for kind in ("Display", "Camera")
    }
    return planted.rig_file(planted.quarter(), folder / "mine.toml", **drivers)


@pytest.fixture(scope="module")
def ran(rig_file: Path, folder: Path) -> Result:
    out = "--summary", folder / "run.json", "--record", folder / "run.h5"
    return typed(run_command, "--rig", rig_file, "--frames", 16, "--no-strips", *out)


def test_it_says_so_measures_the_rest_and_points_to_calibrate(ran, rig_file):
    assert ran.exit_code == 1
    assert f"! {rig_file}: not calibrated" in ran.output
    assert f"zeromethod calibrate --rig {rig_file}" in ran.output
    assert "do not touch the mirror" in ran.output
    assert "depth is relative" in str(ran.exception)


def test_check_has_nothing_to_compare_it_with(rig_file, folder):
    assert_refused(typed(check_command, "--rig", rig_file), f"{rig_file}: never calibrated")
    assert not list(folder.rglob("checks.csv"))


def test_summary_marks_depth_as_relative(ran, folder):
    figures = json.loads((folder / "run.json").read_text())
    assert figures["state"] == "not calibrated"
    assert not figures["calibrated"]
    assert figures["nulled_frames"] == 0
    # the rest as measured is seen: nothing presses, and no peak of millimetres appears on the way
    assert figures["residual_px_rms"] < 0.05
    assert abs(figures["depth_peak_mm"]) < 5 * figures["depth_peak_sigma_mm"] + 5e-3


def test_recording_is_never_locked_and_keeps_what_is_not_known(ran, folder):
    with Recording(folder / "run.h5") as recording:
        states = {recording.state_of(row) for row in recording.steps}
        assert State.UNCALIBRATED in states
        assert not states & {State.LOCKED, State.RESTING}
        assert recording.rig.geometry.relative
        # nothing is read on the way to the null, where a picture that came late reads as a millimetre
        assert set(recording.peaks["state"]) == {"not calibrated"}
        assert np.all(np.abs(recording.peaks["depth_mm"]) < 0.02)
        surface = recording.surface(int(recording.steps_with("surface")[-1]))
        assert surface.sigma_x_mm[surface.valid].min() > 0.1
