"""What a command writes: the file that a disk does not take is named."""

import warnings

import pytest
from command_line import run

from zeromethod.cli.output import write_summary
from zeromethod.errors import InputError


def test_a_summary_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"^--summary: .*b\.json: cannot be written: No such file"):
        write_summary(tmp_path / "gone" / "b.json", {})


def test_a_warning_is_one_line(capsys):
    with warnings.catch_warnings():
        run("--version")
        warnings.simplefilter("always")
        warnings.warn("a.h5: frames/image:\n damaged", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "! a.h5: frames/image: damaged\n"
