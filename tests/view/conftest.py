"""One recording for all that look at one, and copies of it with other contents."""

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from recorded_run import recorded, small_rig, sum_again
from report_page import HOSTILE


@pytest.fixture(scope="session")
def recording_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """0.6 s of a press that is there at once, on a rig with a hostile name."""
    rig = small_rig().model_copy(update={"name": HOSTILE})
    return recorded(tmp_path_factory.mktemp("recorded") / "press.h5", 0.6, rig=rig)


@pytest.fixture
def edited(recording_path: Path, tmp_path: Path) -> Callable[[Callable[[h5py.File], object]], Path]:
    """Make a copy with something changed in it."""

    def edit(change: Callable[[h5py.File], object]) -> Path:
        path = tmp_path / "edited.h5"
        shutil.copy(recording_path, path)
        with h5py.File(path, "r+", libver="latest") as file:
            change(file)
            sum_again(file)
        return path

    return edit
