"""Every refusal of a rig file: one line with file, key, value and what is allowed."""

import datetime
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.keys import set_value
from zeromethod.rig.load import load_rig, packaged_rigs

SIMULATED = resource("calibration", "rigs", "simulated.toml").read_text()


def changed(values: dict[str, Any]) -> str:
    """The packaged rig file with values by dotted key; None takes a key out."""
    data = tomllib.loads(SIMULATED)
    for key, value in values.items():
        set_value(data, key, value)
    return tomlkit.dumps(data)


def refusal(tmp_path: Path, text: str | bytes) -> str:
    """The message's part after the file name."""
    file = tmp_path / "rig.toml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        load_rig(file)
    message = str(caught.value)
    assert not [word for word in ("\n", "http", "pydantic") if word in message]
    assert message.startswith(f"{file}: ")
    return message.removeprefix(f"{file}: ")


@pytest.mark.parametrize("name", packaged_rigs())
def test_packaged_rigs_load_by_bare_name_and_by_path(name):
    assert load_rig(name) == load_rig(resource("calibration", "rigs", f"{name}.toml"))
    assert load_rig(name).name == name
    assert {"simulated", "paper"} <= set(packaged_rigs())


@pytest.mark.parametrize(
    ("name", "reason"),
    [("nowhere.toml", "cannot be read: No such file or directory"), ("", "a folder: give a")],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, reason):
    with pytest.raises(InputError, match=f"{name}.*: {reason}"):
        load_rig(tmp_path / name)


def test_text_that_is_not_utf8_or_not_toml_is_refused_with_its_place(tmp_path):
    assert refusal(tmp_path, b'name = "\xff"\n') == "byte 8: not UTF-8: a rig file (TOML)"
    assert "line 3" in refusal(tmp_path, "schema_version = 1\n\nname = \n")


REST = "prism.rest"
LENGTH = "prism.pattern_length_mm"
POSITION = "camera.position_mm"
KNOWN = {"x_mm": [5.0, 1.0], "y_mm": [0.0, 1.0]}
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"schema_version": None}, "schema_version: missing: 2 is what"),
    ({"schema_version": 3}, "schema_version: 3: 2 is what"),
    ({"schema_version": True}, "schema_version: true: 2 is what"),
    # unknown keys, before any other that their misspelling leaves out
    ({"targets.kind": "noise"}, "targets: unknown key: did you mean target?"),
    ({"prism.widht_mm": 60.0, "prism.width_mm": None}, "prism.widht_mm: unknown key: did you mean width_mm?"),
    ({"display.pitch": 0.1}, "display.pitch: unknown key: did you mean pitch_mm?"),
    ({"camera.zoom": 1}, "camera.zoom: unknown key: known are driver, columns"),
    ({"camera.noise.read_gray": 1}, "camera.noise.read_gray: unknown key: did you mean read_grey?"),
    ({"pattern_layers[0].n": 2}, "pattern_layers[0].n: unknown key: known are index, thickness_mm"),
    ({"foo.a": 1, "prism": 3}, "foo: unknown key: known are schema_version, name, prism"),
    # missing keys
    ({"prism.width_mm": None}, "prism.width_mm: missing: a number above 0"),
    ({"camera.look_at_mm": None}, "camera.look_at_mm: missing: a list of 3 numbers"),
    ({"camera.projection": None}, 'camera.projection: missing: one of "perspective", "orthographic"'),
    # numbers
    ({"display.columns": 1920.5}, "display.columns: 1920.5: a whole number at least 16 and at most 16384"),
    ({"display.columns": 8}, "display.columns: 8: a whole number at least 16"),
    ({"control.timeout_s": math.inf}, "control.timeout_s: inf: a number above 0"),
    ({"display.mirrored": 1}, "display.mirrored: 1: true or false"),
    ({"target.period_px": 15}, "target.period_px: 15: a whole number"),
    ({"prism.index": 1.0}, "prism.index: 1.0: a number above 1 and at most 4"),
    ({"pattern_layers[0].index": 0.9}, "pattern_layers[0].index: 0.9: a number at least 1 and at most 4"),
    ({"simulation.seed": -1}, "simulation.seed: -1: a whole number at least 0"),
    # text, choices, tables
    ({"name": ""}, 'name: "": text that is not empty'),
    ({"scenario": 3}, "scenario: 3: text that is not empty"),
    ({"camera.bits": 9}, "camera.bits: 9: one of 8, 10, 12, 14, 16"),
    ({"display.scan": "left"}, 'display.scan: "left": one of "down", "up"'),
    ({REST: 3}, "prism.rest: 3: a table"),
    ({"prism.rest.file": 3}, "prism.rest.file: 3: a file name"),
    # lists
    ({POSITION: [1.0, 2.0]}, "camera.position_mm"),
    ({POSITION: [275.7, math.nan, 0.0]}, "camera.position_mm[1]: nan: a number"),
    ({"display.fill_factor": [0.9, 0.0]}, "display.fill_factor[1]: 0.0: a number above 0 and at most 1"),
    ({"display.fill_factor": 1.0}, "display.fill_factor: 1.0: a list of 2 numbers, each a number above 0"),
    ({"display.response_light": [0.0, 2.0]}, "display.response_light[1]: 2.0: a number at least 0"),
    ({"display.response_light": "a"}, 'display.response_light: "a": a list, each a number at least 0'),
    # what is no length
    *[
        ({LENGTH: value}, f"prism.pattern_length_mm: {shown}: a number above 0")
        for value, shown in [
            ("60", '"60"'),
            (True, "true"),
            ([60.0], "[60.0]"),
            ({"a": 1}, "a table"),
            (datetime.date(2024, 1, 1), '"2024-01-01"'),
            (math.nan, "nan"),
            (math.inf, "inf"),
            (-60.0, "-60.0"),
        ]
    ],
    # keys that contradict each other
    ({LENGTH: None}, f"{LENGTH}: missing: exactly one of pattern_length_mm and mirror_length_mm"),
    ({"prism.mirror_length_mm": 77.0}, "prism.mirror_length_mm: 77.0: exactly one of pattern_length_mm and"),
    ({"camera.focal_px": None}, "camera.focal_px: missing: two numbers above 0"),
    ({"camera.projection": "orthographic"}, "camera.pixel_mm: missing: a number above 0"),
    ({"camera.look_at_mm": [277.1102, 0.0, -197.2809]}, "camera.look_at_mm: [277"),
    ({"camera.exposure_s": 0.02}, "camera.exposure_s: 0.02: at most the frame time, 0.0166667"),
    ({"camera.noise.black_grey": 255.0}, "camera.noise.black_grey: 255.0: below 255"),
    ({"target.mean": 0.6}, "target.contrast: 0.9: at most 1 / mean - 1 = 0.666667"),
    ({"camera.rows": 68, "target.period_px": 18}, "target.period_px: 18: at most a quarter of 68 camera px"),
    ({"display.response_light": [0, 0.5, 0.5]}, "display.response_light: [0.0, 0.5, 0.5]: two or more"),
    ({"surface.known_rest": [KNOWN]}, "surface.known_rest[0].x_mm: [5.0, 1.0]: from, to with from below to"),
    ({REST: {"shape": "sphere"}}, "prism.rest.radius_mm: missing: a number other"),
    ({REST: {"shape": "map"}}, "prism.rest.file: missing: a .npy file"),
    ({REST: {"shape": "map", "file": "a.npy"}}, "prism.rest.pitch_mm: missing"),
    ({REST: {"radius_mm": 9.0}}, "prism.rest.radius_mm: 9.0: only with shape 'sphere'"),
    ({REST: {"file": "a.npy"}}, 'prism.rest.file: "a.npy": only with shape'),
    # only the first error is reported
    ({LENGTH: -1.0, "camera.bits": 9}, "prism.pattern_length_mm: -1.0: a number above 0"),
    # files that are not there
    ({REST: {"shape": "map", "file": "a.npy", "pitch_mm": 1}}, 'prism.rest.file: "a.npy": an existing .npy'),
    ({"camera.rest_map": "no.npz"}, 'camera.rest_map: "no.npz": an existing .npz or .h5 file'),
    ({"scenario": "no.toml"}, 'scenario: "no.toml": an existing press file or a packaged name'),
]


@pytest.mark.parametrize(("values", "message"), REFUSED, ids=lambda case: str(case)[:40])
def test_wrong_keys_and_values_are_refused_alike_in_a_file_and_in_an_edit(tmp_path, values, message):
    said = refusal(tmp_path, changed(values))
    assert said.startswith(message)
    with pytest.raises(InputError) as caught:
        load_rig("simulated").replace(values)
    assert str(caught.value) == f"rig: {said}"


TEETH = "prism.teeth"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({f"{TEETH}.count": 41}, f"{TEETH}.count: 41: a whole number at least 1 and at most 40"),
        ({f"{TEETH}.base_deviation_mm": [0.1]}, f"{TEETH}.base_deviation_mm: [0.1]: 10 numbers from -1 to 1"),
        (
            {f"{TEETH}.camera_sigma_deg": [0.1] * 9},
            f"{TEETH}.camera_sigma_deg: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1",
        ),
        ({f"{TEETH}.pattern_sigma_deg": [2.0]}, f"{TEETH}.pattern_sigma_deg: [2.0]: 10 numbers from 0 to 1"),
        (
            {f"{TEETH}.base_mm": 0.3, f"{TEETH}.base_deviation_mm": [0.0] * 9 + [-0.5]},
            f"{TEETH}.base_deviation_mm: -0.5: at least -0.3, as base_mm is 0.3",
        ),
        (
            {"prism.camera_angle_deg": 84.5, f"{TEETH}.camera_deviation_deg": [0.0] * 9 + [0.6]},
            f"{TEETH}.camera_deviation_deg: 0.6: with camera_angle_deg 84.5 above 5 and below 85",
        ),
        (
            {"prism.mirror_length_mm": None, LENGTH: 60.0},
            f"{LENGTH}: 60.0: mirror_length_mm with prism.teeth",
        ),
        ({"cloth": {}}, "cloth: a table: no table with camera.pupil_mm or prism.teeth: not simulated"),
    ],
)
def test_teeth_that_cannot_be_are_refused(values, message):
    with pytest.raises(InputError) as caught:
        load_rig("thin").replace(values)
    assert str(caught.value).startswith(f"rig: {message}")


@pytest.mark.parametrize(
    "values",
    [
        {"target.period_px": 64},
        {"camera.rows": 64},
        {"camera.rows": 66},
        {"prism.pattern_length_mm": 60},  # whole numbers are numbers
    ],
)
def test_the_limits_themselves_are_allowed(tmp_path, values):
    file = tmp_path / "rig.toml"
    file.write_text(changed(values))
    assert load_rig(file) == load_rig("simulated").replace(values)


def test_an_older_file_is_refused_with_what_to_rename(tmp_path):
    text = SIMULATED.replace("schema_version = 2", "schema_version = 1")
    assert refusal(tmp_path, text) == "schema_version: 1: 2 is what this version of zeromethod reads"
    for new, old in (("scenario", "press"), ("pattern_length_mm", "leg_mm"), ("fill_factor", "fill")):
        text = text.replace(f"{new} = ", f"{old} = ")
    text = text.replace("camera_angle_deg", "captured_angle_deg") + "[[captured_layers]]\nindex = 1.5\n"
    assert refusal(tmp_path, text).partition(", after renaming ")[2] == (
        "press to scenario, prism.captured_angle_deg to camera_angle_deg, prism.leg_mm to pattern_length_mm, "
        "captured_layers to camera_layers, display.fill to fill_factor"
    )


@pytest.mark.parametrize("table", ["camera", "display"])
def test_only_drivers_of_others_take_options_of_their_own(tmp_path, table):
    file = tmp_path / "rig.toml"
    own = {f"{table}.serial": "A1"}
    file.write_text(changed({f"{table}.driver": "other"} | own))
    assert getattr(load_rig(file), table).model_extra == {"serial": "A1"}
    for driver in ("simulated", None):
        text = changed({f"{table}.driver": driver} | own)
        assert refusal(tmp_path, text).startswith(f"{table}.serial: unknown key: ")


def test_files_lie_relative_to_the_rig_file(tmp_path, monkeypatch):
    folder = tmp_path / "bench"
    folder.mkdir()
    np.save(folder / "rest.npy", np.zeros((4, 4)))
    (folder / "press.toml").write_text("")
    rest = {"shape": "map", "file": "rest.npy", "pitch_mm": 1.0}
    (folder / "rig.toml").write_text(changed({"scenario": "press.toml", REST: rest}))
    monkeypatch.chdir(tmp_path)
    rig = load_rig("bench/rig.toml")
    assert rig.prism.rest.file == Path("bench/rest.npy")
    assert rig.scenario == str(Path("bench/press.toml"))
