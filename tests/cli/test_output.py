"""What a command writes: the file that a disk does not take is named."""

import warnings

import pytest
from command_line import run, start

from zeromethod.cli.output import folder_for, write_summary
from zeromethod.errors import InputError


def test_a_summary_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"^--summary: .*b\.json: cannot be written: No such file"):
        write_summary(tmp_path / "gone" / "b.json", {})


def test_a_folder_in_which_nothing_was_kept_is_removed_with_those_made_for_it(tmp_path):
    folder = tmp_path / "calibrations" / "bench"
    with folder_for("--rig", folder):
        assert folder.is_dir()
    assert list(tmp_path.iterdir()) == []
    with folder_for("--rig", folder):
        (tmp_path / "calibrations" / "checks.csv").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["calibrations", "checks.csv"]


def test_a_warning_is_one_line(capsys):
    with warnings.catch_warnings():
        run("--version")
        warnings.simplefilter("always")
        warnings.warn("a.h5: frames/image:\n damaged", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "! a.h5: frames/image: damaged\n"


def test_who_closes_the_output_is_not_told_that_a_driver_failed():
    with start("devices") as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0
