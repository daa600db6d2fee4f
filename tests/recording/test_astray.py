"""A recording whose file is moved, deleted, replaced or cut while it is written: named, and nothing is lost
that the open file still holds.
"""

import os
import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hanging import eventually
from planted_steps import a_step, recorder

from zeromethod.recording.recording import Recording
from zeromethod.recording.status import LOST, Condition


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another recording of the same bench, longer than these."""
    path = tmp_path_factory.mktemp("other") / "other.h5"
    with recorder(path) as recording:
        for number in range(1, 31):
            recording.add_step(a_step(number))
    return path


def moved(path: Path, _: Path) -> None:
    path.rename(path.with_name("moved.h5"))


def folder_moved(path: Path, _: Path) -> None:
    path.parent.rename(path.parent.with_name("elsewhere"))


def deleted(path: Path, _: Path) -> None:
    shutil.rmtree(path.parent)


def replaced(path: Path, other: Path) -> None:
    moved(path, other)
    shutil.copy(other, path)


def cut(path: Path, _: Path) -> None:
    os.truncate(path, 5000)


def written_over(path: Path, other: Path) -> None:
    shutil.copyfile(other, path)  # into the same file, as cp does


@pytest.mark.parametrize(
    ("happens", "words", "kept_in"),
    [
        (moved, r"run.h5 is gone; what is recorded is in /.*/moved.h5", "here/moved.h5"),
        (folder_moved, r"run.h5 is gone; what is recorded is in /.*/elsewhere/run.h5", "elsewhere/run.h5"),
        (replaced, r"run.h5 is another file now; what is recorded is in /.*/moved.h5", "here/moved.h5"),
        (deleted, r"run.h5 is gone; what is recorded is in /proc/\d+/fd/\d+ until the run ends", None),
        (cut, r"run.h5: another program has cut it short or written over it", None),
        (written_over, r"run.h5: another program has cut it short or written over it", None),
    ],
)
def test_a_file_that_another_program_lays_hands_on_is_named_within_a_second(
    happens: Callable[[Path, Path], None], words: str, kept_in: str | None, other: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    path = folder / "run.h5"
    with recorder(path) as recording:
        for number in range(1, 6):
            recording.add_step(a_step(number))
        eventually(lambda: recording.waiting_bytes == 0)
        assert recording.status.condition is Condition.ALL_KEPT
        happens(path, other)
        number = 5

        def said() -> bool:
            nonlocal number
            number += 1
            recording.add_step(a_step(number))
            time.sleep(0.02)
            return recording.status.condition in LOST

        eventually(said)
        assert re.search(words, str(recording.status))
    assert recording.status.condition is Condition.ASTRAY
    if kept_in is not None:
        with Recording(tmp_path / kept_in) as found:
            assert found.complete
            assert len(found.steps) == number
            assert not found.damaged()
    if happens in (replaced, written_over):
        assert path.read_bytes() == other.read_bytes()
