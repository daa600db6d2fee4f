"""Opening a file at the moment at which another process begins to write it."""

import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from zeromethod.errors import InputError
from zeromethod.recording import opening
from zeromethod.recording.opening import open_along

BEGIN = """
import sys, time
import h5py
file = h5py.File(sys.argv[1], "r+", libver="latest", locking=False)
print("begun", flush=True)
time.sleep(0.5)
if sys.argv[2] == "go on":
    file.swmr_mode = True
    print("written along", flush=True)
    sys.stdin.read()
else:
    import os
    os._exit(1)
"""


def begun(path: Path, then: str) -> subprocess.Popen[str]:
    """A process that has just opened the file for itself."""
    with h5py.File(path, "w", libver="latest") as file:
        file["a"] = 1
    command = [sys.executable, "-c", BEGIN, str(path), then]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    return process


def test_a_writer_that_just_begins_is_waited_for(tmp_path):
    with begun(tmp_path / "a.h5", "go on") as process, open_along(tmp_path / "a.h5") as file:
        assert process.stdout.readline() == "written along\n"
        assert file["a"][()] == 1
        process.communicate()


def test_one_that_was_killed_as_it_began_is_refused_after_a_while(tmp_path, monkeypatch):
    monkeypatch.setattr(opening, "BEGINNING_S", 1.0)
    with begun(tmp_path / "a.h5", "die") as process:
        process.communicate()
    with pytest.raises(InputError, match=r"a\.h5: cannot be read as a recording"):
        open_along(tmp_path / "a.h5")
