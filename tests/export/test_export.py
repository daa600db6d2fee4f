"""What holds for every format: selection, refusals, whole files, memory."""

import shutil
import weakref
from pathlib import Path

import h5py
import numpy as np
import pytest

from zeromethod import InputError, Recording
from zeromethod.export import MESHES, SUFFIXES, Selection, prepare
from zeromethod.recording import DamagedWarning

STREAMED = [suffix for suffix, form in SUFFIXES.items() if form in {"npz", "tiff", "mcap", "mp4"}]


def refused(recording: Recording, name: str, selection: Selection | None = None) -> str:
    with pytest.raises(InputError) as error:
        prepare(recording, Path(name), selection=selection)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("kept", "names", "words"),
    [
        (
            ("frames", "residual", "warps"),
            ("a.npz", "a.tif", "a.ply", "a.stl", "a.mp4"),
            "surface not kept by the run's --keep (kept: frames, residual, warps)",
        ),
        (("surface",), ("a.mp4",), "a video needs frames, residual, surface: frames, residual not kept"),
        ((), ("a.npz",), "surface not kept by the run's --keep (kept: the tables alone)"),
        ((), ("a.mcap",), "an MCAP file needs frames, surface: frames, surface not kept"),
    ],
)
def test_what_keep_left_out_is_named(with_only, kept, names, words):
    with Recording(with_only(*kept)) as recording:
        for name in names:
            assert words in refused(recording, name)
        # The peak's track is always there.
        assert len(prepare(recording, Path("a.csv")).selected.steps) == 9


def test_a_time_with_nothing_in_it_is_refused(recording):
    found = refused(recording, "a.npz", Selection(from_s=0.13, to_s=0.17))
    assert "no surface recorded from 0.13 to 0.170 s; the recording is 0.220 s long" in found
    assert "--at: 3: the recording ends at 0.220 s" in refused(recording, "a.ply", Selection(at_s=3.0))
    for wrong in ({"from_s": -1.0}, {"to_s": float("nan")}, {"from_s": 2.0, "to_s": 1.0}):
        with pytest.raises(InputError, match=r"^--(from|to): "):
            Selection(**wrong)


def test_an_unknown_suffix_and_a_missing_library_say_what_to_do(recording, monkeypatch):
    assert "must end in .npz, .tif" in refused(recording, "a.obj")
    monkeypatch.setitem(__import__("sys").modules, "tifffile", None)
    assert refused(recording, "a.tif") == (
        "export: needs the library tifffile: pip install 'zeromethod[export]'"
    )


@pytest.mark.parametrize("suffix", list(SUFFIXES))
def test_no_format_leaves_half_a_file(suffix, recording, tmp_path):
    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare(recording, tmp_path / f"a{suffix}").write(stop)
    # A mesh is of one time: it is whole by the first step.
    assert [path.name for path in tmp_path.iterdir()] == (
        [f"a{suffix}"] if suffix in {".ply", ".stl"} else []
    )


def damaged_copy(planted, path: Path, name: str, *at: int) -> Path:
    """The planted recording with one value changed on its disk."""
    shutil.copy(planted.path, path)
    with h5py.File(path, "r+", libver="latest") as file:
        if name == "peaks/table":
            row = file[name][at[0]]
            row["depth_mm"] += 0.2
            file[name][at[0]] = row
        else:
            file[name][at] += 1
    return path


@pytest.mark.parametrize(
    ("suffix", "name"), [*((suffix, "surface/depth_mm") for suffix in STREAMED), (".mp4", "frames/image")]
)
def test_what_is_damaged_is_left_out_and_the_rest_written(suffix, name, planted, tmp_path):
    # of the first reading: that which places a lattice
    path = damaged_copy(planted, tmp_path / "damaged.h5", name, 0, 20, 20)
    output = tmp_path / f"a{suffix}"
    with Recording(path) as recording:
        with pytest.warns(DamagedWarning, match=name):
            figures = prepare(recording, output).write()
        assert recording.tables.left_out() == {name.partition("/")[0]: 1}
    assert output.stat().st_size > 1000
    if suffix == ".npz":
        with np.load(output) as data:
            assert [bool(valid.any()) for valid in data["valid"]] == [False] + 7 * [True]
            assert np.isnan(data["depth_mm"][0]).all()
            assert figures["times"] == 8


@pytest.mark.parametrize("suffix", [suffix for suffix, form in SUFFIXES.items() if form in MESHES])
def test_a_mesh_of_a_damaged_surface_is_refused(suffix, planted, tmp_path):
    path = damaged_copy(planted, tmp_path / "damaged.h5", "surface/depth_mm", -1, 20, 20)
    with Recording(path) as recording:
        with pytest.raises(InputError, match=r"the surface at 0\.220 s is damaged: give another time"):
            prepare(recording, tmp_path / f"a{suffix}").write()
        prepare(recording, tmp_path / f"b{suffix}", selection=Selection(at_s=0.2)).write()
    assert not (tmp_path / f"a{suffix}").exists()


def test_a_track_says_which_peak_is_damaged(planted, tmp_path):
    path = damaged_copy(planted, tmp_path / "damaged.h5", "peaks/table", 3)
    with Recording(path) as recording, pytest.warns(DamagedWarning, match="peaks/table"):
        assert prepare(recording, tmp_path / "a.csv").write() == {"times": 9, "peaks": 7}
    lines = (tmp_path / "a.csv").read_text().splitlines()[1:]
    assert [line.endswith(",peak") for line in lines] == [step == 5 for step in planted.steps]
    assert lines[4].split(",")[1:] == [*[""] * 8, "locked", "", "peak"]


@pytest.mark.parametrize("suffix", STREAMED)
def test_few_of_the_maps_are_in_memory_at_a_time(suffix, recording, tmp_path, monkeypatch):
    alive: list[weakref.ref] = []
    most = 0
    read = recording.surface

    def watched(step: int):
        nonlocal most
        most = max(most, sum(one() is not None for one in alive))
        surface = read(step)
        if surface is not None:
            alive.append(weakref.ref(surface.depth_mm))
        return surface

    monkeypatch.setattr(recording, "surface", watched)
    prepare(recording, tmp_path / f"a{suffix}").write()
    assert len(alive) >= 8
    # The one in use, and the one before while it is read; a TIFF and a video also looked at the first.
    assert most <= 2


def test_a_pitch_that_is_no_length_is_refused(recording, tmp_path):
    with pytest.raises(InputError, match=r"^--pitch: .*: a finite number of mm above 0$"):
        prepare(recording, tmp_path / "a.tif", pitch_mm=-1.0).write()
