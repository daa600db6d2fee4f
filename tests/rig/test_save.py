"""Values go back into a rig file without harm to the rest of it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from zeromethod import InputError, load_rig
from zeromethod.resources import resource
from zeromethod.rig.save import save_values

SIMULATED = resource("calibration", "rigs", "simulated.toml")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return Path(shutil.copy(SIMULATED, tmp_path / "rig.toml"))


def test_saving_nothing_changes_no_byte(file):
    save_values(file, {})
    assert file.read_bytes() == SIMULATED.read_bytes()


def test_a_saved_value_changes_its_line_only(file):
    save_values(file, {"display.rise_s": 0.005})
    before, after = SIMULATED.read_text().splitlines(), file.read_text().splitlines()
    (line,) = (b for a, b in zip(before, after, strict=True) if a != b)
    assert line.startswith("rise_s = 0.005 ")
    assert line.endswith("# 10 to 90 % of a step in light")


def test_saved_values_are_read_back_exactly(file):
    values = {
        "camera.position_mm": np.array([1 / 3, -2e-17, -198.5]),
        "camera.focal_px": (8301.25, np.float64(8299.5)),
        "pattern_layers[0].thickness_mm": 0.512,
        "surface.known_rest": [{"x_mm": [0.0, 2.0], "y_mm": [-5.0, 5.0]}],
        "prism.rest.shape": "sphere",
        "prism.rest.radius_mm": 900.0,
        "display.mirrored": True,
    }
    save_values(file, values)
    assert load_rig(file) == load_rig("simulated").replace(values)
    comments = [line.split("#")[1] for line in SIMULATED.read_text().splitlines() if "#" in line]
    assert [line.split("#")[1] for line in file.read_text().splitlines() if "#" in line] == comments


def test_a_new_key_ends_its_own_table(file):
    save_values(file, {"rubber.youngs_modulus_sigma_mpa": 0.01, "pattern_layers[0].index_sigma": None})
    lines = file.read_text().splitlines()
    added = lines.index("youngs_modulus_sigma_mpa = 0.01")
    before = SIMULATED.read_text().splitlines()
    assert lines[:added] + lines[added + 1 :] == before
    assert [lines[added - 1][:7], lines[added + 1]] == ["support", ""]


def test_line_ends_and_links_are_kept(file):
    file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    link = file.with_name("link.toml")
    link.symlink_to(file)
    save_values(link, {"prism.index": 1.42})
    assert link.is_symlink()
    assert b"index = 1.42 " in file.read_bytes()
    assert file.read_bytes().count(b"\r\n") == file.read_bytes().count(b"\n")


def test_destination_leaves_the_original_alone(file, tmp_path):
    copy = tmp_path / "calibrated.toml"
    save_values(file, {"prism.index": 1.405}, destination=copy)
    assert file.read_bytes() == SIMULATED.read_bytes()
    assert load_rig(copy).prism.index == 1.405


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"prism.index": 0.5}, "prism.index: 0.5: a number above 1"),
        ({"prism.index": float("nan")}, "prism.index: nan: a number above 1"),
        ({"prism.indx": 1.5}, "prism.indx: unknown key: did you mean index?"),
        ({"pattern_layers[3].index": 1.5}, r"pattern_layers\[3\].index: 1.5: a key of a rig file"),
        ({"name.first": 1.5}, "name.first: 1.5: a key of a rig file"),
        ({"": 1.5}, ": 1.5: a key of a rig file"),
        ({"prism.index": None}, "prism.index: missing: a number above 1"),
        ({"prism..index": 1.5}, "prism..index: 1.5: a key of a rig file"),
        ({"prism.index": object}, "a value of TOML"),
    ],
)
def test_refused_values_leave_the_file_as_it_was(file, values, message):
    with pytest.raises(InputError, match=message) as caught:
        save_values(file, values)
    assert "\n" not in str(caught.value)
    assert file.read_bytes() == SIMULATED.read_bytes()
    assert [path.name for path in file.parent.iterdir()] == ["rig.toml"]


def test_a_failed_write_leaves_the_old_file_whole(file, monkeypatch):
    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full_disk)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        save_values(file, {"prism.index": 1.42})
    assert file.read_bytes() == SIMULATED.read_bytes()
    assert [path.name for path in file.parent.iterdir()] == ["rig.toml"]


def test_the_files_mode_is_kept(file):
    file.chmod(0o640)
    save_values(file, {"prism.index": 1.42})
    assert file.stat().st_mode & 0o777 == 0o640


def test_a_file_that_is_not_toml_is_refused(file):
    file.write_text("a = = 1\n")
    with pytest.raises(InputError, match="not TOML"):
        save_values(file, {"prism.index": 1.42})
