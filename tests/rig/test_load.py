"""Every refusal of a rig file: one line with file, key, value and what is allowed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.rig.load import load_rig, packaged_rigs
from zeromethod.rig.model import Rig

SIMULATED = resource("calibration", "rigs", "simulated.toml").read_text()


def refusal(tmp_path: Path, text: str | bytes) -> str:
    """The message's part after the file name."""
    file = tmp_path / "rig.toml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        load_rig(file)
    message = str(caught.value)
    assert "\n" not in message
    assert "http" not in message
    assert "pydantic" not in message
    assert message.startswith(f"{file}: ")
    return message.removeprefix(f"{file}: ")


def changed(old: str, new: str) -> str:
    """The packaged rig with one line replaced."""
    assert old in SIMULATED
    return SIMULATED.replace(old, new, 1)


@pytest.mark.parametrize("name", packaged_rigs())
def test_packaged_rigs_load_by_bare_name_and_by_path(name: str) -> None:
    assert load_rig(name) == load_rig(resource("calibration", "rigs", f"{name}.toml"))
    assert load_rig(name).name == name


def test_both_promised_rigs_are_packaged() -> None:
    assert {"simulated", "paper"} <= set(packaged_rigs())


def test_unknown_bare_name_lists_the_packaged_ones() -> None:
    with pytest.raises(
        InputError, match=r'^rig: "simulate": a file, or one of the packaged paper, simulated, virtual$'
    ):
        load_rig("simulate")


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read: No such file or directory"):
        load_rig(tmp_path / "nowhere.toml")


def test_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        load_rig(tmp_path)


def test_text_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    assert refusal(tmp_path, b'name = "\xff"\n') == "byte 8: not UTF-8: a rig file is UTF-8 text"


def test_broken_toml_is_refused_with_its_line(tmp_path: Path) -> None:
    assert "line 3" in refusal(tmp_path, "schema_version = 1\n\nname = \n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema_version = 2\n", "", "schema_version: missing: 2 is what"),
        ("schema_version = 2", "schema_version = 3", "schema_version: 3: 2 is what"),
        ("schema_version = 2", "schema_version = true", "schema_version: true: 2 is what"),
        ('name = "simulated"', 'name = ""', 'name: "": text that is not empty'),
        ("[target]", "[targets]", "targets: unknown key: did you mean target?"),
        ("width_mm", "widht_mm", "prism.widht_mm: unknown key: did you mean width_mm?"),
        ("pitch_mm", "pitch", "display.pitch: unknown key: did you mean pitch_mm?"),
        ("psf_px", "zoom", "camera.zoom: unknown key: known are driver, columns"),
        ("read_grey", "read_gray", "camera.noise.read_gray: unknown key: did you mean read_grey?"),
        (
            "index = 1.0\n",
            "index = 1.0\nn = 2\n",
            "pattern_layers[0].n: unknown key: known are index, thickness_mm",
        ),
        ("width_mm = 60.0", "#", "prism.width_mm: missing: a number above 0"),
        ("look_at_mm = ", "# ", "camera.look_at_mm: missing: a list of 3 numbers"),
        (
            'projection = "perspective"',
            "",
            'camera.projection: missing: one of "perspective", "orthographic"',
        ),
        (
            "columns = 1920",
            "columns = 1920.5",
            "display.columns: 1920.5: a whole number at least 16 and at most 16384",
        ),
        ("columns = 1920", "columns = 8", "display.columns: 8: a whole number at least 16"),
        ("position_mm = [277.1102, 0.0, -197.2809]", "position_mm = [1.0, 2.0]", "camera.position_mm"),
        ("[277.1102, 0.0, -197.2809]", "[275.7, nan, 0.0]", "camera.position_mm[1]: nan: a number"),
        (
            "fill_factor = [0.9, 0.85]",
            "fill_factor = [0.9, 0.0]",
            "display.fill_factor[1]: 0.0: a number above 0 and at most 1",
        ),
        (
            "fill_factor = [0.9, 0.85]",
            "fill_factor = 1.0",
            "display.fill_factor: 1.0: a list of 2 numbers, each a number above 0",
        ),
        ("[prism]", "prism = 3\n[other]", "other: unknown key"),
        ("[control]", "[control]\ntimeout_s = 1e400", "control.timeout_s: inf: a number above 0"),
        ("index = 1.41", "index = 1.41\nrest = 3", "prism.rest: 3: a table"),
        ("index = 1.41", "index = 1.41\nrest = {file = 3}", "prism.rest.file: 3: a file name"),
        ('scenario = "default"', "scenario = 3", "scenario: 3: text that is not empty"),
        ('stripes = "none"', "mirrored = 1", "display.mirrored: 1: true or false"),
        ("gamma = 2.2", "response_light = [0.0, 2.0]", "display.response_light[1]: 2.0: a number at least 0"),
        (
            "gamma = 2.2",
            'response_light = "a"',
            'display.response_light: "a": a list, each a number at least 0',
        ),
        ("bits = 8", "bits = 9", "camera.bits: 9: one of 8, 10, 12, 14, 16"),
        ('scan = "down"', 'scan = "left"', 'display.scan: "left": one of "down", "up"'),
        ("period_px = 16", "period_px = 15", "target.period_px: 15: a whole number"),
        ("index = 1.41", "index = 1.0", "prism.index: 1.0: a number above 1 and at most 4"),
        ("index = 1.0", "index = 0.9", "pattern_layers[0].index: 0.9: a number at least 1 and at most 4"),
        ("[control]", "[other]", "other: unknown key: known are schema_version, name, prism"),
        ("seed = 0", "seed = -1", "simulation.seed: -1: a whole number at least 0"),
    ],
)
def test_wrong_key_or_value_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert refusal(tmp_path, changed(old, new)).startswith(message)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ('"60"', '"60"'),
        ("true", "true"),
        ("[60.0]", "[60.0]"),
        ("{a = 1}", "a table"),
        ("2024-01-01", '"2024-01-01"'),
        ("nan", "nan"),
        ("inf", "inf"),
        ("-60.0", "-60.0"),
    ],
)
def test_what_is_no_length_is_refused(tmp_path: Path, value: str, shown: str) -> None:
    text = changed("pattern_length_mm = 60.0", f"pattern_length_mm = {value}")
    assert refusal(tmp_path, text) == f"prism.pattern_length_mm: {shown}: a number above 0"


def test_an_older_file_is_refused_with_what_to_rename(tmp_path: Path) -> None:
    text = changed("schema_version = 2", "schema_version = 1")
    assert refusal(tmp_path, text) == "schema_version: 1: 2 is what this version of zeromethod reads"
    for new, old in (("scenario", "press"), ("pattern_length_mm", "leg_mm"), ("fill_factor", "fill")):
        text = text.replace(f"{new} = ", f"{old} = ")
    text = text.replace("camera_angle_deg", "captured_angle_deg") + "[[captured_layers]]\nindex = 1.5\n"
    assert refusal(tmp_path, text).partition(", after renaming ")[2] == (
        "press to scenario, prism.captured_angle_deg to camera_angle_deg, prism.leg_mm to pattern_length_mm, "
        "captured_layers to camera_layers, display.fill to fill_factor"
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "pattern_length_mm = 60.0",
            "",
            "prism.pattern_length_mm: missing: exactly one of pattern_length_mm and mirror_length_mm",
        ),
        (
            "pattern_length_mm = 60.0",
            "pattern_length_mm = 60.0\nmirror_length_mm = 77.0",
            "prism.mirror_length_mm: 77.0: exactly one of pattern_length_mm and mirror_length_mm",
        ),
        ("focal_px = [9000.0, 9000.0]", "", "camera.focal_px: missing: two numbers above 0"),
        ('"perspective"', '"orthographic"', "camera.pixel_mm: missing: a number above 0"),
        (
            "look_at_mm = [42.0, 0.0, 0.0]",
            "look_at_mm = [277.1102, 0.0, -197.2809]",
            "camera.look_at_mm: [277",
        ),
        (
            "exposure_s = 0.008",
            "exposure_s = 0.02",
            "camera.exposure_s: 0.02: at most the frame time, 0.0166667",
        ),
        ("black_grey = 4.0", "black_grey = 255.0", "camera.noise.black_grey: 255.0: below 255"),
        ("mean = 0.5", "mean = 0.6", "target.contrast: 0.9: at most 1 / mean - 1 = 0.666667"),
        ("period_px = 16", "period_px = 64", None),
        ("rows = 1024", "rows = 64", None),
        ("rows = 1024", "rows = 66\n", None),
        (
            "gamma = 2.2",
            "response_light = [0.0, 0.5, 0.5]",
            "display.response_light: [0.0, 0.5, 0.5]: two or more",
        ),
        (
            "[target]",
            "[[surface.known_rest]]\nx_mm = [5.0, 1.0]\ny_mm = [0.0, 1.0]\n[target]",
            "surface.known_rest[0].x_mm: [5.0, 1.0]: from, to with from below to",
        ),
        (
            "index = 1.41",
            'index = 1.41\nrest = {shape = "sphere"}',
            "prism.rest.radius_mm: missing: a number other",
        ),
        ("index = 1.41", 'index = 1.41\nrest = {shape = "map"}', "prism.rest.file: missing: a .npy file"),
        (
            "index = 1.41",
            'index = 1.41\nrest = {shape = "map", file = "a.npy"}',
            "prism.rest.pitch_mm: missing",
        ),
        (
            "index = 1.41",
            "index = 1.41\nrest = {radius_mm = 9.0}",
            "prism.rest.radius_mm: 9.0: only with shape 'sphere'",
        ),
        (
            "index = 1.41",
            'index = 1.41\nrest = {file = "a.npy"}',
            'prism.rest.file: "a.npy": only with shape',
        ),
        (
            "index = 1.41",
            'index = 1.41\nrest = {shape = "map", file = "a.npy", pitch_mm = 1.0}',
            'prism.rest.file: "a.npy": an existing .npy file',
        ),
        (
            'scenario = "default"',
            'scenario = "nowhere.toml"',
            'scenario: "nowhere.toml": an existing press file',
        ),
    ],
)
def test_keys_that_contradict_each_other_are_refused(
    tmp_path: Path, old: str, new: str, message: str | None
) -> None:
    if message is None:
        file = tmp_path / "rig.toml"
        file.write_text(changed(old, new))
        assert isinstance(load_rig(file), Rig)
    else:
        assert refusal(tmp_path, changed(old, new)).startswith(message)


def test_target_period_must_fit_four_times_into_the_image(tmp_path: Path) -> None:
    text = changed("rows = 1024", "rows = 68").replace("period_px = 16", "period_px = 18")
    assert refusal(tmp_path, text).startswith("target.period_px: 18: at most a quarter of 68 camera px")


def test_only_the_first_error_is_reported(tmp_path: Path) -> None:
    text = changed("pattern_length_mm = 60.0", "pattern_length_mm = -1.0").replace("bits = 8", "bits = 9")
    assert refusal(tmp_path, text) == "prism.pattern_length_mm: -1.0: a number above 0"


def test_whole_numbers_are_numbers(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(changed("pattern_length_mm = 60.0", "pattern_length_mm = 60"))
    assert load_rig(file).prism.pattern_length_mm == 60.0


@pytest.mark.parametrize("table", ["camera", "display"])
def test_drivers_of_others_take_options_of_their_own(tmp_path: Path, table: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(
        changed(f'[{table}]\ndriver = "simulated"', f'[{table}]\ndriver = "other"\nserial = "A1"')
    )
    assert getattr(load_rig(file), table).model_extra == {"serial": "A1"}


@pytest.mark.parametrize("driver", ['driver = "simulated"', ""])
@pytest.mark.parametrize("table", ["camera", "display"])
def test_simulated_devices_take_no_options_beyond_the_known(tmp_path: Path, table: str, driver: str) -> None:
    text = changed(f'[{table}]\ndriver = "simulated"', f'[{table}]\n{driver}\nserial = "A1"')
    assert refusal(tmp_path, text).startswith(f"{table}.serial: unknown key: ")


def test_files_lie_relative_to_the_rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "bench"
    folder.mkdir()
    np.save(folder / "rest.npy", np.zeros((4, 4)))
    (folder / "press.toml").write_text("")
    text = changed('scenario = "default"', 'scenario = "press.toml"')
    text = text.replace(
        "index = 1.41", 'index = 1.41\nrest = {shape = "map", file = "rest.npy", pitch_mm = 1.0}'
    )
    (folder / "rig.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    rig = load_rig("bench/rig.toml")
    assert rig.prism.rest.file == Path("bench/rest.npy")
    assert rig.scenario == str(Path("bench/press.toml"))
