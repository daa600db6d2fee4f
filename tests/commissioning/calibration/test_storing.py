"""A calibration as a folder, and back: nothing that matters is lost."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import assert_refused, typed

from zeromethod import MeasurementError, Peak, Rig, load_rig
from zeromethod.calibration import Direct, MirrorEdge, Presses, describe
from zeromethod.calibration.folder import Stored, calibration_of, calibrations, load, load_arrays, newest
from zeromethod.cli.calibrate import calibrate_command
from zeromethod.commissioning.calibration import (
    Calibration,
    evaluate,
    evaluate_or_keep,
    recall,
    store_calibration,
)
from zeromethod.view.calibration_figure import draw_calibration

from . import planted
from .conftest import DEPTHS_MM
from .planted import nominal


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return planted.rig_file(nominal(), tmp_path_factory.mktemp("bench") / "mine.toml")


@pytest.fixture(scope="module")
def stored(calibration: Calibration, rig_file: Path) -> Stored:
    pictures = {"calibration.png": lambda path: draw_calibration(calibration, path)}
    return store_calibration(calibration, rig_file, pictures=pictures)


def test_folder_lies_next_to_the_rig_and_is_whole(stored, rig_file):
    assert stored.folder.parent == rig_file.parent / "calibrations" / "mine"
    names = {path.name for path in stored.folder.iterdir()}
    assert names == {"calibration.toml", "rig.toml", "given.toml", "arrays.h5", "calibration.png"}
    assert calibrations(rig_file) == [stored.folder]
    assert (stored.folder / "calibration.png").read_bytes().startswith(b"\x89PNG")


def test_calibrated_rig_file_is_the_fitted_rig(stored, calibration):
    kept, fitted = describe(load_rig(stored.rig_file)), describe(calibration.rig)
    # ten digits; directions are taken back out of positions
    assert kept == pytest.approx(fitted, rel=1e-8, abs=1e-7)
    assert load_rig(stored.rig_file).display.latency_s == calibration.recorded.values["display.latency_s"]
    assert "# silicone rubber" in stored.rig_file.read_text()
    assert describe(load_rig(stored.folder / "given.toml")) == pytest.approx(describe(nominal()))


def test_calibrated_rig_file_states_what_is_left_open(stored, calibration):
    stated = load_rig(stored.rig_file).geometry
    assert stated.known == "calibrated"
    assert stated.date == stored.document["time"].isoformat()
    error = calibration.error
    depth, *place = stated.sigmas(error.x_mm, error.y_mm)
    # a quadratic through nine regions
    np.testing.assert_allclose(100.0 * depth, error.percent, rtol=0.1)
    np.testing.assert_allclose(place, error.place_mm, rtol=0.1)


def test_document_states_parameters_presses_and_verdict(stored, calibration):
    document = stored.document
    for name, (value, sigma) in stored.parameters.items():
        assert value == pytest.approx(calibration.fitted.values[name], rel=1e-6, abs=1e-9)
        assert sigma == pytest.approx(calibration.fitted.sigma[name], rel=1e-6)
    assert document["verdict"]["level"] == calibration.verdict.level
    assert [press["depth_mm"] for press in document["press"]] == list(DEPTHS_MM)
    assert document["depth_error"]["percent"] == pytest.approx(calibration.depth_percent, rel=1e-6)
    kept, found = (
        [row["depth_rms_nm"] for row in one["curve"]] for one in (document["carrier"], calibration.carrier)
    )
    assert kept == pytest.approx(found, rel=1e-6)


def test_newest_and_own_calibration_are_found(stored, rig_file):
    found = newest(rig_file)
    assert found.folder == stored.folder
    of_rig = calibration_of(stored.rig_file)
    assert of_rig.document == stored.document
    assert calibration_of(rig_file) is None


def test_rest_map_and_covariance_are_in_the_arrays(stored, calibration):
    arrays = load_arrays(stored.folder, "rest_map/lcd_px", "rest_map/valid", "fit/covariance")
    np.testing.assert_array_equal(arrays["rest_map/lcd_px"], calibration.rest.rest_map.lcd_px)
    np.testing.assert_array_equal(arrays["rest_map/valid"], calibration.rest.rest_map.valid)
    np.testing.assert_array_equal(arrays["fit/covariance"], calibration.fitted.covariance)


def test_what_was_known_by_hand_comes_back(calibration, rig_file, tmp_path):
    known = (Direct("gap_mm", 0.6, 0.01), MirrorEdge("R0", np.array([[120.5, 64.0]]), 2.0))
    plan = replace(calibration.recorded.plan, known=known)
    with_known = replace(calibration, recorded=replace(calibration.recorded, plan=plan))
    recorded, _ = recall(store_calibration(with_known, rig_file, home=tmp_path).folder)
    gap, edge = recorded.plan.known
    assert isinstance(gap, Direct)
    assert (gap.parameter, gap.value, gap.sigma_value) == ("gap_mm", 0.6, 0.01)
    assert isinstance(edge, MirrorEdge)
    assert (edge.edge, edge.pixel.tolist(), edge.sigma_px) == ("R0", [[120.5, 64.0]], 2.0)


def test_what_was_recorded_evaluates_to_the_same_again_once_a_mistyped_depth_is_put_right(
    calibration, rig_file, tmp_path
):
    mistyped = replace(calibration.recorded.plan, press_depths_mm=(DEPTHS_MM[0], 0.25))
    wrong = evaluate(replace(calibration.recorded, plan=mistyped), calibration.rest)
    assert wrong.verdict.level == "bad"
    assert any("contradicts" in words and "takes --press-depths" in words for words in wrong.verdict.findings)
    folder = store_calibration(wrong, rig_file, home=tmp_path / "mistyped").folder
    again = ("--evaluate-again", folder, "--output", tmp_path / "right", "--press-depths")
    assert_refused(
        typed(calibrate_command, *again, "0.2"), f"--press-depths: 0.2: {folder} has 2 presses: as many"
    )
    assert_refused(typed(calibrate_command, *again, "0.2,15"), "--press-depths: 15: depths in mm, at most")
    result = typed(calibrate_command, *again, ",".join(map(str, DEPTHS_MM)))
    assert result.exit_code == 0, result.output
    (document,) = (tmp_path / "right").glob("*/calibration.toml")
    right = load(document.parent)
    assert right.document["redone_from"] == folder.name
    assert [press["depth_mm"] for press in right.document["press"]] == list(DEPTHS_MM)
    for name, value in calibration.fitted.values.items():
        # the file has seven digits of the hold and ten of the delay; the fit stops within 3 % of a sigma
        found = right.parameters[name][0]
        assert found == pytest.approx(value, abs=0.05 * calibration.fitted.sigma[name] + 1e-6 * abs(value))
    recorded, _ = recall(folder)
    np.testing.assert_array_equal(recorded.rest.sums, calibration.recorded.rest.sums)


def test_recording_outlives_an_evaluation_that_fails(calibration, rig_file, tmp_path, monkeypatch):
    def unseen(presses: Presses, rig: Rig, with_sigma: bool = True) -> list[Peak]:
        if presses.presses[0].depth_mm in DEPTHS_MM:
            raise MeasurementError("press 1: not seen")
        return peaks(presses, rig, with_sigma)  # made-up ones, of depth's error

    peaks = Presses.peaks

    monkeypatch.setattr(Presses, "peaks", unseen)
    kept = evaluate_or_keep(calibration.recorded, calibration.rest)
    assert kept.verdict.level == "bad"
    assert kept.verdict.reason == "press 1: not seen: geometry from the rest map alone"
    # what was recorded is there for another try: sums of the frames, presses and their depths
    recorded, _ = recall(store_calibration(kept, rig_file, home=tmp_path).folder)
    assert len(recorded.presses.pressed) == len(DEPTHS_MM)
    assert recorded.plan.press_depths_mm == DEPTHS_MM
    np.testing.assert_array_equal(recorded.rest.sums, calibration.recorded.rest.sums)
