"""`zeromethod calibrate` as a person meets it: a whole calibration, showing, comparing, refusals."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from command_line import run
from commands import assert_refused, typed
from commissioning.calibration import planted
from rich.console import Console

from zeromethod.calibration import Intrinsics
from zeromethod.calibration.camera_file import save_camera
from zeromethod.calibration.folder import Stored, calibrations, load
from zeromethod.calibration.intrinsics import CameraFit
from zeromethod.cli import calibrate_bench
from zeromethod.cli.calibrate import calibrate_command
from zeromethod.commissioning.calibration import recall
from zeromethod.commissioning.calibration.rest import decode
from zeromethod.rig.load import load_rig

MODULE = "commissioning.calibration.planted"
SIMULATED = ("--rig", "simulated")


def calibrate(*arguments: object) -> Result:
    return typed(calibrate_command, *arguments)


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig file whose devices are those of a bench that stands otherwise than it says."""
    drivers = {f"{kind.lower()}.driver": f"{MODULE}:Planted{kind}" for kind in ("Display", "Camera")}
    return planted.rig_file(planted.quarter(), tmp_path_factory.mktemp("bench") / "mine.toml", **drivers)


@pytest.fixture(scope="module")
def made(rig_file: Path) -> Result:
    summary = rig_file.parent / "found.json"
    return calibrate(
        *("--rig", rig_file, "--no-light", "--no-delay", "--frames", 2),
        *("--known", "display.along_mm=31.1:0.5", "--summary", summary),
    )


def test_whole_calibration_ends_in_a_folder_and_a_table(made, rig_file):
    assert made.exit_code == 0, made.output
    (folder,) = calibrations(rig_file)
    assert "the LCD's turn in its plane" in made.output
    assert "depth in millimetres" in made.output
    assert f"zeromethod run --rig {folder / 'rig.toml'}" in made.output
    assert (folder / "calibration.png").stat().st_size > 10_000
    rig = load_rig(folder / "rig.toml")
    assert rig.display.driver == f"{MODULE}:PlantedDisplay"


def test_document_names_devices_edges_and_what_to_measure_next(made, rig_file):
    (folder,) = calibrations(rig_file)
    document = load(folder).document
    assert document["fingerprint"]["camera"]["serial"] == "0042"
    assert document["fingerprint"]["display"]["name"] == "Planted 5.5"
    assert document["edge"] == [{"name": name, "words": "not in view"} for name in ("P0", "R0")]
    assert "edge P0: not in view" in made.output
    assert not any(one["name"].startswith("edge") for one in document["fit"]["data"])
    # no press is known: depth is uncertain, and a press is what helps
    assert document["verdict"]["level"] == "uncertain"
    assert "measure next" in document["verdict"]["reason"]
    assert document["measure_next"]
    summary = json.loads((rig_file.parent / "found.json").read_text())
    assert summary["folder"] == str(folder)
    assert summary["parameters"] == document["parameters"]


def test_camera_by_itself_is_taken_in_later(made, rig_file, tmp_path):
    folder, rig = calibrations(rig_file)[0], load_rig(rig_file)
    focal, size = rig.camera.focal_px[0], (rig.camera.rows, rig.camera.columns)
    sigma = np.array([1e-3 * focal, 1e-3 * focal, 0.05])
    values = np.array([1.01 * focal, 1.01 * focal, 0.0])
    camera = Intrinsics(("fx", "fy", "k1"), values, np.diag(sigma**2))
    path = tmp_path / "camera.toml"
    save_camera(path, CameraFit(camera, 0.1, ("a", "b", "c", "d"), 100, 0, size), "a board")
    again = calibrate("--evaluate-again", folder, "--intrinsics", path, "--no-edges", "--output", tmp_path)
    assert again.exit_code == 0, again.output
    (redone,) = (one.parent for one in tmp_path.glob("*/calibration.toml"))
    scale, spread = load(redone).parameters["camera.scale"]
    assert spread < 1.1e-3
    assert scale == pytest.approx(1.01, abs=3e-3)
    kept = load(redone).document["recorded"]
    assert kept["edges"] is False
    assert any(one.get("camera") == ["fx", "fy", "k1"] for one in kept["known"])
    save_camera(path, CameraFit(camera, 0.1, ("a", "b", "c", "d"), 100, 0, (10, 20)), "a board")
    refused = calibrate("--evaluate-again", folder, "--intrinsics", path)
    assert_refused(refused, "20 x 10 px: the rig's camera has")
    without = calibrate("--evaluate-again", folder, "--press-ball", "800:4")
    assert_refused(without, "no ball was pressed")


def test_show_prints_the_newest_or_the_one_named(made, rig_file):
    folder = calibrations(rig_file)[0]
    for arguments in (("--rig", rig_file, "--show"), ("--show", folder)):
        shown = calibrate(*arguments)
        assert shown.exit_code == 0, shown.output
        assert "depth in millimetres" in shown.output
        assert "uncertain" in shown.output


def test_evaluating_again_adds_what_was_measured_later_and_diff_shows_it(made, rig_file, tmp_path):
    folder = calibrations(rig_file)[0]
    again = calibrate("--evaluate-again", folder, "--known", "gap_mm=0.62:0.01", "--output", tmp_path)
    assert again.exit_code == 0, again.output
    (redone,) = (path.parent for path in tmp_path.glob("*/calibration.toml"))
    before, after = load(folder), load(redone)
    assert after.document["redone_from"] == folder.name
    assert after.document["recorded"]["known"][:-1] == before.document["recorded"]["known"]
    assert after.parameters["gap_mm"][1] < 0.011
    assert after.document["depth_error"]["percent"] < before.document["depth_error"]["percent"]
    differences = calibrate("--diff", folder, redone)
    assert differences.exit_code == 0
    assert "the gap in front of the LCD" in differences.output
    assert "depth's sigma, percent" in differences.output


@pytest.mark.parametrize(("level", "offered"), [("good", True), ("uncertain", True), ("bad", False)])
def test_bad_calibration_is_not_offered_for_use(level, offered, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(calibrate_bench, "_print", lambda *_: None)
    stored = Stored(tmp_path / "my bench", {"verdict": {"level": level}})
    calibrate_bench._print_stored(Console(width=300), stored, None, " --display 1 --camera 0")
    printed = capsys.readouterr().out
    assert f"stored in {tmp_path}" in printed
    use = f"use it: zeromethod run --rig '{tmp_path}/my bench/rig.toml' --display 1 --camera 0"
    assert (use in printed) is offered


def test_arrays_that_are_missing_are_reported(tmp_path, capsys):
    calibrate_bench._warn_of_arrays(Stored(tmp_path, {}))
    printed = capsys.readouterr().err
    assert printed == f"! {tmp_path / 'arrays.h5'}: missing: run and --evaluate-again will refuse it\n"


def test_interrupted_before_the_rest_map_nothing_is_left(tmp_path, monkeypatch):
    def terminated(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60.0)  # the signal's handler ends it at once

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(calibrate_bench, "record", terminated)
    outcome = run("calibrate --rig simulated --press-depths 0.2")
    assert outcome.code == 130
    assert outcome.err.endswith("interrupted: nothing was stored\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("during", ["evaluate_or_keep", "_store"])
def test_interrupted_later_what_was_recorded_is_stored(during, made, rig_file, tmp_path, monkeypatch):
    recorded, _ = recall(calibrations(rig_file)[0])
    found = decode(recorded.rig.replace(recorded.values), recorded.rest)
    then = getattr(calibrate_bench, during)

    def interrupted(*given: object) -> object:
        os.kill(os.getpid(), signal.SIGINT)
        return then(*given)

    monkeypatch.setattr(calibrate_bench, "record", lambda *_: (recorded, found))
    monkeypatch.setattr(calibrate_bench, during, interrupted)
    result = calibrate("--rig", rig_file, "--output", tmp_path / "out")
    assert isinstance(result.exception, SystemExit | KeyboardInterrupt), result.output
    (folder,) = (tmp_path / "out").iterdir()
    assert f"stored in {folder}" in result.output.replace("\n", "")
    stored = load(folder)
    if during == "_store":  # it was whole by then
        assert stored.document["verdict"]["level"] != "bad"
    else:
        assert stored.document["verdict"]["reason"].startswith("interrupted before the fit was done")
        assert f"zeromethod calibrate --evaluate-again {folder}" in result.output.replace("\n", "")
    assert recall(folder)[0].plan.press_depths_mm == recorded.plan.press_depths_mm
