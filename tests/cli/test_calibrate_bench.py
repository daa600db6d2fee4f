"""`zeromethod calibrate` as a person meets it: a whole calibration, showing, comparing, refusals."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from zeromethod.calibration import Intrinsics
from zeromethod.calibration.camera_file import save_camera
from zeromethod.calibration.folder import Stored, calibrations, load
from zeromethod.calibration.intrinsics import CameraFit
from zeromethod.cli import calibrate_bench
from zeromethod.cli.calibrate import calibrate_command
from zeromethod.commissioning.calibration import recall
from zeromethod.commissioning.calibration.first_fit import with_values
from zeromethod.commissioning.calibration.rest import decode
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig
from zeromethod.rig.save import save_values

REPOSITORY = Path(__file__).parents[2]


def told(*arguments: object) -> Result:
    return CliRunner(env={"COLUMNS": "160"}).invoke(calibrate_command, [str(one) for one in arguments])


@pytest.fixture(scope="module")
def planted() -> Iterator[ModuleType]:
    """The simulated bench that stands otherwise than its rig file says, importable as a driver."""
    path = REPOSITORY / "tests" / "commissioning" / "calibration" / "planted.py"
    spec = importlib.util.spec_from_file_location("planted_bench", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["planted_bench"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["planted_bench"]


@pytest.fixture(scope="module")
def rig_file(planted: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    rig, path = planted.quarter(), tmp_path_factory.mktemp("bench") / "mine.toml"
    values = {
        "display.driver": "planted_bench:PlantedDisplay",
        "display.columns": rig.display.columns,
        "display.rows": rig.display.rows,
        "display.pitch_mm": rig.display.pitch_mm,
        "camera.driver": "planted_bench:PlantedCamera",
        "camera.columns": rig.camera.columns,
        "camera.rows": rig.camera.rows,
        "camera.focal_px": rig.camera.focal_px,
        "camera.centre_px": rig.camera.centre_px,
        "target.period_px": rig.target.period_px,
        "scenario": "none",
    }
    save_values(REPOSITORY / "calibration" / "rigs" / "simulated.toml", values, path)
    return path


@pytest.fixture(scope="module")
def made(rig_file: Path) -> Result:
    summary = rig_file.parent / "found.json"
    return told(
        *("--rig", rig_file, "--no-light", "--no-delay", "--frames", 2),
        *("--known", "display.along_mm=31.1:0.5", "--summary", summary),
    )


def test_whole_calibration_ends_in_a_folder_and_a_table(made: Result, rig_file: Path) -> None:
    assert made.exit_code == 0, made.output
    (folder,) = calibrations(rig_file)
    assert "the LCD's turn in its plane" in made.output
    assert "depth in millimetres" in made.output
    assert f"zeromethod run --rig {folder / 'rig.toml'}" in made.output
    assert (folder / "calibration.png").stat().st_size > 10_000
    rig = load_rig(folder / "rig.toml")
    assert rig.display.driver == "planted_bench:PlantedDisplay"


def test_fingerprint_names_the_devices_that_were_open(made: Result, rig_file: Path) -> None:
    fingerprint = load(calibrations(rig_file)[0]).fingerprint
    assert fingerprint["camera"]["serial"] == "0042"
    assert fingerprint["display"]["name"] == "Planted 5.5"


def test_edges_that_are_out_of_view_are_not_found(made: Result, rig_file: Path) -> None:
    document = load(calibrations(rig_file)[0]).document
    assert document["edge"] == [
        {"name": "P0", "words": "not in view"},
        {"name": "R0", "words": "not in view"},
    ]
    assert "edge P0: not in view" in made.output
    assert not any(one["name"].startswith("edge") for one in document["fit"]["data"])


def test_camera_by_itself_is_taken_in_later(made: Result, rig_file: Path, tmp_path: Path) -> None:
    folder, rig = calibrations(rig_file)[0], load_rig(rig_file)
    assert rig.camera.focal_px is not None
    focal, size = rig.camera.focal_px[0], (rig.camera.rows, rig.camera.columns)
    sigma = np.array([1e-3 * focal, 1e-3 * focal, 0.05])
    values = np.array([1.01 * focal, 1.01 * focal, 0.0])
    camera = Intrinsics(("fx", "fy", "k1"), values, np.diag(sigma**2))
    path = tmp_path / "camera.toml"
    save_camera(path, CameraFit(camera, 0.1, ("a", "b", "c", "d"), 100, 0, size), "a board")
    again = told("--evaluate-again", folder, "--intrinsics", path, "--no-edges", "--output", tmp_path)
    assert again.exit_code == 0, again.output
    (redone,) = (one.parent for one in tmp_path.glob("*/calibration.toml"))
    scale, spread = load(redone).parameters["camera.scale"]
    assert spread < 1.1e-3
    assert scale == pytest.approx(1.01, abs=3e-3)
    kept = load(redone).document["recorded"]
    assert kept["edges"] is False
    assert any(one.get("camera") == ["fx", "fy", "k1"] for one in kept["known"])
    save_camera(path, CameraFit(camera, 0.1, ("a", "b", "c", "d"), 100, 0, (10, 20)), "a board")
    refused = told("--evaluate-again", folder, "--intrinsics", path)
    assert isinstance(refused.exception, InputError)
    assert "20 x 10 px: the rig's camera has" in str(refused.exception)
    without = told("--evaluate-again", folder, "--press-ball", "800:4")
    assert isinstance(without.exception, InputError)
    assert "no ball was pressed" in str(without.exception)


def test_what_to_measure_next_is_told(made: Result, rig_file: Path) -> None:
    # no press is known: depth is uncertain, and a press is what helps
    document = load(calibrations(rig_file)[0]).document
    assert document["verdict"]["level"] == "uncertain"
    assert "measure next" in document["verdict"]["reason"]
    assert document["measure_next"]


def test_summary_holds_the_same_figures(made: Result, rig_file: Path) -> None:
    found = json.loads((rig_file.parent / "found.json").read_text())
    folder = calibrations(rig_file)[0]
    assert found["folder"] == str(folder)
    assert found["parameters"] == load(folder).document["parameters"]


def test_show_tells_the_newest_or_the_one_named(made: Result, rig_file: Path) -> None:
    folder = calibrations(rig_file)[0]
    for arguments in (("--rig", rig_file, "--show"), ("--show", folder)):
        shown = told(*arguments)
        assert shown.exit_code == 0, shown.output
        assert "depth in millimetres" in shown.output
        assert "uncertain" in shown.output


def test_redo_adds_what_was_measured_later_and_diff_tells_the_change(
    made: Result, rig_file: Path, tmp_path: Path
) -> None:
    folder = calibrations(rig_file)[0]
    again = told("--evaluate-again", folder, "--known", "gap_mm=0.62:0.01", "--output", tmp_path)
    assert again.exit_code == 0, again.output
    (redone,) = (path.parent for path in tmp_path.glob("*/calibration.toml"))
    before, after = load(folder), load(redone)
    assert after.document["redone_from"] == folder.name
    assert after.document["recorded"]["known"][:-1] == before.document["recorded"]["known"]
    assert after.parameters["gap_mm"][1] < 0.011
    assert after.document["depth_error"]["percent"] < before.document["depth_error"]["percent"]
    told_apart = told("--diff", folder, redone)
    assert told_apart.exit_code == 0
    assert "the gap in front of the LCD" in told_apart.output
    assert "depth's sigma, percent" in told_apart.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--rig: missing"),
        (("--rig", "simulated", "--press-depths", "0.2,x"), "--press-depths"),
        (("--rig", "simulated", "--press-depths", "-0.2"), "--press-depths"),
        (("--rig", "simulated", "--depth-sigma", "0"), "--depth-sigma"),
        (("--rig", "simulated", "--known", "gap_mm=0.5"), "--known"),
        (("--rig", "simulated", "--known", "speed=0.5:0.1"), "not a parameter"),
        (("--rig", "simulated", "--known", "gap_mm=nan:1"), "must be finite"),
        (("--rig", "simulated", "--known", "gap_mm=0.5:inf"), "must be finite"),
        (("--rig", "simulated", "--known", "gap_mm=-3:0.01"), "gap_mm=-3: a number at least 0"),
        (
            ("--rig", "simulated", "--known", "prism.captured_less_pattern_deg=80:1"),
            "camera_angle_deg: 130",
        ),
        (("--rig", "simulated", "--known", "prism.pattern_angle_deg=90:1"), "at least 5 and at most 85"),
        (("--rig", "paper", "--known", "camera.k1=0:0.1"), "this rig has none"),
        (("--evaluate-again", "nowhere", "--known", "gap_mm=nan:1"), "must be finite"),
        (("--rig", "simulated", "--press-depths", "0.2,1000"), "--press-depths: 1000: depths in mm, at most"),
        (("--rig", "simulated", "--edge-point", "Q0=1,2"), "--edge-point"),
        (("--rig", "simulated", "--edge-point", "P0=1"), "--edge-point"),
        (("--rig", "simulated", "--edge-point", "P0=1300,5"), "1280 x 1024"),
        (("--rig", "simulated", "--press-ball", "800"), "--press-ball"),
        (("--rig", "simulated", "--press-ball", "-800:4"), "--press-ball"),
        (("--rig", "simulated", "--press-ball", "nan:4"), "--press-ball"),
        (("--rig", "simulated", "--intrinsics", "nowhere.toml"), "--intrinsics: nowhere.toml"),
        (("--rig", "simulated", "--summary", "found.txt"), "--summary"),
        (("--show",), "--show"),
        (("--show", "nowhere"), "nowhere"),
        (("--diff", "nowhere", "nowhere"), "nowhere"),
        (("--evaluate-again", "nowhere"), "nowhere"),
        (("--evaluate-again", "nowhere", "--display", "1"), "--display: not with --evaluate-again"),
        (("--diff", "a", "b", "--summary", "d.json"), "--summary: not with --diff; allowed: none other"),
        (
            ("--show", "nowhere", "--known", "gap_mm=0.5:0.1"),
            "--known: not with --show; allowed: --rig, --summary",
        ),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delattr(calibrate_bench, "open_devices")  # nothing may come as far as that
    result = told(*arguments)
    assert isinstance(result.exception, InputError), result.output
    assert words in str(result.exception)
    assert "\n" not in str(result.exception)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("level", "offered"), [("good", True), ("uncertain", True), ("bad", False)])
def test_bad_calibration_is_not_offered_for_use(
    level: str,
    offered: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(calibrate_bench, "_print", lambda *_: None)
    stored = Stored(tmp_path / "my bench", {"verdict": {"level": level}})
    calibrate_bench._print_stored(Console(width=300), stored, None, " --display 1 --camera 0")
    told_lines = capsys.readouterr().out
    assert f"stored in {tmp_path}" in told_lines
    use = f"use it: zeromethod run --rig '{tmp_path}/my bench/rig.toml' --display 1 --camera 0"
    assert (use in told_lines) is offered


def test_arrays_that_are_missing_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibrate_bench._warn_of_arrays(Stored(tmp_path, {}))
    told_line = capsys.readouterr().err
    assert told_line == f"! {tmp_path / 'arrays.h5'}: missing: run and --evaluate-again will refuse it\n"


def test_interrupted_before_the_rest_map_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def terminated(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5.0)  # the signal's handler ends it at once

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(calibrate_bench, "record", terminated)
    result = told("--rig", "simulated", "--press-depths", "0.2")
    assert isinstance(result.exception, SystemExit | KeyboardInterrupt), result.output
    assert "interrupted: nothing was stored" in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("during", ["evaluate_or_keep", "_store"])
def test_interrupted_later_what_was_recorded_is_stored(
    during: str, made: Result, rig_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded, _ = recall(calibrations(rig_file)[0])
    found = decode(with_values(recorded.rig, recorded.values), recorded.rest)
    then = getattr(calibrate_bench, during)

    def interrupted(*given: object) -> object:
        os.kill(os.getpid(), signal.SIGINT)
        return then(*given)

    monkeypatch.setattr(calibrate_bench, "record", lambda *_: (recorded, found))
    monkeypatch.setattr(calibrate_bench, during, interrupted)
    result = told("--rig", rig_file, "--output", tmp_path / "out")
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


def test_rig_without_calibration_has_none_to_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = told("--rig", "simulated", "--show")
    assert isinstance(result.exception, InputError)
    assert "no calibration" in str(result.exception)
