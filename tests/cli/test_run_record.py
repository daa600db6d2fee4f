"""`zeromethod run --record`: what a person sees of it."""

import json
import resource
from collections.abc import Iterator

import pytest
from command_line import run
from small_rigs import small_rig_file

from zeromethod.recording.recording import Recording


@pytest.mark.parametrize(("keep", "kept"), [("surface", {"surface"}), ("none", set())])
def test_only_what_is_asked_for_is_kept(tmp_path, keep, kept):
    rig, path = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5"
    line = f"run --scenario step --frames 12 --keep {keep} --every 3 --rig"
    assert run(line, rig, "--record", path).code == 0
    with Recording(path) as recording:
        assert (set(recording.kept), recording.every) == (kept, 3)
        assert len(recording.steps) >= 12
        assert recording.image(4) is None
        read = [step for step in recording.steps["number"] if recording.surface(int(step)) is not None]
        assert bool(read) == bool(kept)
        assert all((step - 1) % 3 == 0 for step in read)


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file may be larger than 8 MiB: to a recording, the disk is full there."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8 << 20, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


LIMIT = "the limit of a file's size, 8.39 MB (ulimit -f), is reached"


@pytest.mark.usefixtures("small_files")
def test_a_recording_that_was_ended_early_is_no_success(tmp_path, monkeypatch):
    rig, path, summary = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5", tmp_path / "run.json"
    monkeypatch.setattr("zeromethod.recording.line.RING_BYTES", 1 << 20)
    line = "run --scenario none --frames 12 --rig"
    code, _, err = run(line, rig, "--record", path, "--summary", summary)
    assert code == 1
    assert f"zeromethod: cannot write: --record: disk full: recording stopped at 0.0 s ({LIMIT}), " in err
    # all else is there
    assert LIMIT in json.loads(summary.read_text())["recording_trouble"]
    with Recording(path) as recording:
        assert len(recording.steps) >= 12


@pytest.mark.usefixtures("small_files")
def test_a_limit_of_file_sizes_is_not_called_memory(tmp_path):
    rig, path = small_rig_file(tmp_path / "small.toml"), tmp_path / "run.h5"
    code, _, err = run("run --scenario none --frames 3 --rig", rig, "--record", path)
    assert (code, err.count("\n")) == (2, 1)
    assert err.endswith(f": no 64 MB of shared memory to record by: {LIMIT}\n")
    assert not path.exists()
