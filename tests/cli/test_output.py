"""What a command writes: the file that a disk does not take is named."""

import errno
import warnings

import pytest
from command_line import run

from zeromethod.cli.output import write_summary, writing
from zeromethod.errors import InputError


def test_a_full_disk_names_the_file_that_it_did_not_take(tmp_path):
    path = tmp_path / "a.tif"
    with (
        pytest.raises(InputError, match=r"^OUT: .*a\.tif: cannot be written: No space left on device$"),
        writing("OUT", path),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_summary_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"^--summary: .*b\.json: cannot be written: No such file"):
        write_summary(tmp_path / "gone" / "b.json", {})


def test_a_warning_is_one_line(capsys):
    with warnings.catch_warnings():
        run("--version")
        warnings.simplefilter("always")
        warnings.warn("a.h5: frames/image:\n damaged", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "! a.h5: frames/image: damaged\n"
