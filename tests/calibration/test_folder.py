"""Calibrations on disk: where they lie, what they refuse, and that none is ever half there."""

import os
import tomllib
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zeromethod import InputError, load_rig
from zeromethod.calibration.folder import (
    ARRAYS,
    DOCUMENT,
    RAW_SUMS,
    REST_MAP,
    ArraysFault,
    Stored,
    arrays_fault,
    calibration_of,
    calibrations,
    home_of,
    lacks_document,
    load,
    load_arrays,
    newest,
    store,
)
from zeromethod.rig.save import save_values

TIME = datetime(2025, 3, 1, 12, 30, 5, tzinfo=UTC)
PACKAGED = Path(__file__).parents[2] / "calibration" / "rigs" / "simulated.toml"


def document(**more: Any) -> dict[str, Any]:
    parameter = {"value": 0.51, "sigma": np.float64(0.02), "words": "the gap"}
    return {
        "time": TIME,
        "parameters": {"gap_mm": parameter},
        "fingerprint": {"camera": {"serial": "1"}},
        "verdict": {"level": "good", "reason": "", "findings": []},
        **more,
    }


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_bytes(PACKAGED.read_bytes())
    return path


def made(rig_file: Path, when: datetime = TIME, **more: Any) -> Stored:
    values = {"display.gamma": 2.15}
    return store(rig_file, document(**{"time": when, **more}), values, {"a/b": np.arange(6.0)})


def test_folder_is_named_by_rig_and_time_and_two_in_one_second_are_both_kept(rig_file):
    first, second = made(rig_file), made(rig_file)
    assert first.folder == rig_file.parent / "calibrations" / "mine" / "2025-03-01T12-30-05"
    assert second.folder.name == "2025-03-01T12-30-05-2"
    assert calibrations(rig_file) == [first.folder, second.folder]


def test_newest_is_the_last_made(rig_file):
    assert newest(rig_file) is None
    made(rig_file, TIME + timedelta(days=1), mark="late")
    made(rig_file, TIME, mark="early")
    found = newest(rig_file)
    assert found.document["mark"] == "late"


def test_files_that_the_rig_names_are_found_from_the_folder(rig_file):
    press = rig_file.parent / "tap.toml"
    press.write_bytes((PACKAGED.parents[1] / "presses" / "step.toml").read_bytes())
    np.save(rig_file.parent / "rest.npy", np.zeros((80, 100)))
    rest = {"shape": "map", "file": "rest.npy", "pitch_mm": 1.0, "origin_mm": [-10.0, -40.0]}
    save_values(rig_file, {"scenario": "tap.toml", "prism.rest": rest})
    rig = load_rig(made(rig_file).rig_file)
    assert os.path.samefile(rig.scenario, press)
    assert rig.prism.rest.file is not None
    assert os.path.samefile(rig.prism.rest.file, rig_file.parent / "rest.npy")


def test_calibration_of_a_calibrated_rig_goes_into_the_same_home(rig_file):
    stored = made(rig_file)
    assert home_of(stored.rig_file) == stored.folder.parent
    assert home_of("simulated") == Path("calibrations", "simulated")
    found = calibration_of(stored.rig_file)
    assert found.folder == stored.folder


def test_what_is_no_number_is_left_out_of_the_document(rig_file):
    stored = made(rig_file, nothing=float("nan"), none=None, some={"a": np.float64("inf"), "b": 1})
    assert "nothing" not in stored.document
    assert "none" not in stored.document
    assert stored.document["some"] == {"b": 1}
    assert stored.parameters == {"gap_mm": (0.51, 0.02)}


def test_arrays_come_back_by_name(rig_file):
    folder = made(rig_file).folder
    np.testing.assert_array_equal(load_arrays(folder)["a/b"], np.arange(6.0))
    with pytest.raises(InputError, match="a/c: missing"):
        load_arrays(folder, "a/c")


def test_failure_on_the_way_leaves_no_calibration(rig_file):
    def fail(path: Path) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left"):
        store(rig_file, document(), {}, {}, pictures={"a.png": fail})
    assert calibrations(rig_file) == []
    assert list((rig_file.parent / "calibrations" / "mine").iterdir()) == []
    # and the next one is not hindered
    assert made(rig_file).folder.is_dir()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("schema_version = 2", "schema_version: 2: 1 is what"),
        ("x = ", "Invalid value.*a folder that zeromethod calibrate made"),
        ("schema_version = 1", "time: missing"),
    ],
)
def test_other_files_are_refused(rig_file, text, words):
    folder = made(rig_file).folder
    (folder / DOCUMENT).write_text(text)
    with pytest.raises(InputError, match=words):
        load(folder)


def test_damaged_arrays_are_refused(rig_file):
    folder = made(rig_file).folder
    (folder / ARRAYS).write_bytes(b"not HDF5")
    with pytest.raises(InputError, match="cannot be read"):
        load_arrays(folder)
    assert arrays_fault(folder) is ArraysFault.UNREADABLE
    (folder / ARRAYS).unlink()
    assert arrays_fault(folder) is ArraysFault.MISSING


def test_whole_arrays_have_no_fault_and_a_rest_map_without_its_document_has(rig_file, tmp_path):
    arrays = {REST_MAP: np.zeros((2, 3, 2)), RAW_SUMS: np.zeros((4, 2, 3))}
    stored = store(rig_file, document(), {}, arrays)
    assert arrays_fault(stored.folder) is None
    named = load_rig(stored.rig_file).camera.rest_map
    assert not lacks_document(stored.rig_file, named)
    (stored.folder / DOCUMENT).unlink()
    assert lacks_document(stored.rig_file, named)
    # a rest map made by hand, or none, belongs to no calibration
    assert not lacks_document(stored.rig_file, None)
    assert not lacks_document(stored.rig_file, tmp_path / "rest.npz")


def test_document_is_toml_that_people_can_read(rig_file):
    text = (made(rig_file).folder / DOCUMENT).read_text()
    assert text.startswith("# What `zeromethod calibrate` found")
    assert tomllib.loads(text)["parameters"]["gap_mm"]["value"] == 0.51
