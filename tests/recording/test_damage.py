"""Recordings that a disk or a copy has damaged: reported soon, and never taken for measurements."""

import shutil
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hanging import eventually
from planted_steps import a_step, bench, read, reading, recorder
from recorded_run import sum_again

from zeromethod import Event, InputError, Recording, State
from zeromethod.export.selection import Selection
from zeromethod.recording import DamagedWarning
from zeromethod.recording.damage import KINDS, damaged_words
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.writing import FLUSH_S
from zeromethod.view.report import key_steps
from zeromethod.warp.rest_pixels import RestGrid

STEPS = 8


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same steps: ended in order, and as a killed writer leaves them."""
    folder = tmp_path_factory.mktemp("damage")
    ended, cut = folder / "ended.h5", folder / "cut.h5"
    with recorder(ended) as recording:
        for number in range(1, STEPS + 1):
            recording.add_step(a_step(number))
            recording.add_reading(read(a_step(number)))
        with Recording(ended) as along:

            def all_there() -> bool:
                along.refresh()
                return len(along.steps_with("surface")) == STEPS

            eventually(all_there)
        # the flush that made them seen comes to its end, other arrays included
        time.sleep(5 * FLUSH_S)
        shutil.copy(ended, cut)
    return {"ended": ended, "cut": cut}


def damaged(path: Path, to: Path, start: int, size: int) -> Path:
    """A copy with so many bytes changed."""
    content = bytearray(path.read_bytes())
    content[start : start + size] = bytes(255 - byte for byte in content[start : start + size])
    to.write_bytes(content)
    return to


def place(path: Path, name: str, item: int = 0) -> int:
    """Where in a file an item of a dataset lies; of a table its first."""
    with h5py.File(path, "r", swmr=True) as file:
        dataset = file[name].id
        place = dataset.get_offset()
        return int(dataset.get_chunk_info(item).byte_offset if place is None else place)


OPEN = """
import sys
from zeromethod.errors import InputError
from zeromethod.recording.recording import Recording
for path in sys.argv[1:]:
    try:
        with Recording(path) as found:
            found.steps
    except InputError as error:
        print(error)
"""


@pytest.mark.parametrize("name", ["q", "flags", "mask", "node_pixels", "nodes_u"])
def test_damage_of_the_mirror_at_rest_is_named_and_hides_no_surface(name, files, tmp_path):
    start = place(files["ended"], f"rest/{name}") + 100
    with Recording(damaged(files["ended"], tmp_path / "damaged.h5", start, 1)) as found:
        assert found.damaged() == {"rest": 1}
        np.testing.assert_array_equal(found.surface(3).slope, reading(3)[0].slope.astype(np.float32))
        # the rig's own, or what is said to be damaged
        np.testing.assert_array_equal(found.grid.mesh(), bench()[1].grid.mesh())


def test_rays_that_were_measured_are_not_made_up_where_they_are_damaged(tmp_path):
    rig, rest = bench()
    pixels = np.stack(rest.grid.mesh(), axis=-1) + 0.25
    grid = RestGrid(image_shape=rest.grid.image_shape, period_px=rest.grid.period_px, pixels=pixels)
    path = tmp_path / "run.h5"
    with Recorder(path, rig, replace(rest, grid=grid)) as recording:
        recording.add_step(a_step(1))
    with Recording(path) as found:
        np.testing.assert_array_equal(found.rest.grid.mesh(), grid.mesh())
    with Recording(damaged(path, path, place(path, "rest/node_pixels") + 100, 1)) as found:
        with pytest.warns(DamagedWarning, match="rest/node_pixels: damaged"):
            assert found.grid.shape == grid.shape
        assert found.tables.left_out() == {"rest": 1}
        with pytest.raises(InputError, match="rest/node_pixels: damaged"):
            _ = found.rest


def test_surfaces_are_found_though_every_row_of_the_steps_is_zero(files, tmp_path):
    path = tmp_path / "damaged.h5"
    with h5py.File(files["ended"], "r") as file:
        size = file["steps/table"].dtype.itemsize * STEPS
    content = bytearray(files["ended"].read_bytes())
    start = place(files["ended"], "steps/table")
    content[start : start + size] = bytes(size)
    path.write_bytes(content)
    with Recording(path) as found, Recording(files["ended"]) as whole, warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedWarning)
        assert found.damaged()["steps"] == STEPS
        selected, expected = (Selection().several(one, ("surface",)) for one in (found, whole))
        for name in ("steps", "time_ns", "states"):
            np.testing.assert_array_equal(getattr(selected, name), getattr(expected, name))
        assert key_steps(found) == key_steps(whole)
        assert found.tables.origin_words().endswith("times count from step 1")
        assert whole.tables.origin_words() == ""


def test_where_the_order_of_the_file_is_damaged_it_is_refused_and_not_waited_for(files, tmp_path):
    starts = [(how, start) for how in files for start in (48, 600, 3000)]
    paths = [damaged(files[how], tmp_path / f"{how}-{start}.h5", start, 100) for how, start in starts]
    # a process of its own: what hangs in the HDF5 library cannot be interrupted
    command = [sys.executable, "-c", OPEN, *map(str, paths)]
    reported = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=True
    ).stdout.splitlines()
    assert [line.partition(": ")[0] for line in reported] == [str(path) for path in paths]
    assert all("cannot be read" in line for line in reported)


def test_a_file_that_a_killed_writer_left_reads_as_the_same(files):
    with Recording(files["cut"]) as cut, Recording(files["ended"]) as ended:
        assert (cut.complete, ended.complete) == (False, True)
        assert len(cut.steps) == STEPS
        for number in range(1, STEPS + 1):
            np.testing.assert_array_equal(cut.image(number), ended.image(number))


@pytest.mark.parametrize("how", ["ended", "cut"])
@pytest.mark.parametrize("name", ["steps/table", "surface", "warps/measured/q", "rest/flags"])
def test_what_cannot_be_read_is_named(how, name, files, tmp_path):
    with h5py.File(files[how], "r", swmr=True) as file:
        start = h5py.h5o.get_info(file[name].id).addr
    path = damaged(files[how], tmp_path / "damaged.h5", start + 8, 4)
    with pytest.raises(InputError) as caught:
        Recording(path)
    assert str(caught.value) == f"{path}: {name}: cannot be read: damaged"


@pytest.mark.parametrize("how", ["ended", "cut"])
def test_a_damaged_array_is_left_out_and_its_dataset_reported_once(how, files, tmp_path):
    path = files[how]
    # one bit of a frame, and eight bytes of a warp
    start = place(path, "frames/image", 3)
    content = bytearray(path.read_bytes())
    content[start + 1000] ^= 1
    start = place(path, "warps/measured/q", 4)
    content[start : start + 8] = bytes(8)
    path = tmp_path / "damaged.h5"
    path.write_bytes(content)
    with Recording(path) as found:
        with pytest.warns(DamagedWarning, match=r"damaged\.h5: frames/image: damaged: "):
            image = found.image(4)
        with pytest.warns(DamagedWarning, match=r"damaged\.h5: warps/measured/q: damaged: "):
            warp = found.measured(5)
        # from now on in silence
        assert image is warp is found.frame(4) is found.measured(5) is None
        np.testing.assert_array_equal(found.image(5), a_step(5).image)
        assert found.measured(4) is not None


@pytest.mark.parametrize("how", ["ended", "cut"])
def test_all_that_is_damaged_is_counted_in_silence(how, files, tmp_path):
    path = tmp_path / "damaged.h5"
    shutil.copy(files[how], path)
    for name, item in (
        ("frames/image", 3),
        ("frames/image", 6),
        # two arrays of one item are one that is damaged
        ("surface/slope", 2),
        ("surface/depth_mm", 2),
        ("pictures/q", 1),
    ):
        damaged(path, path, place(path, name, item) + 40, 2)
    # and a number, and a row of a table
    damaged(path, path, place(path, "warps/shown/step") + 8, 1)
    damaged(path, path, place(path, "surface/table"), 1)
    calls: list[None] = []
    with Recording(path) as found, warnings.catch_warnings():
        warnings.simplefilter("error")
        counted = found.damaged(lambda: calls.append(None))
        assert found.is_damaged("frames", 4)
        assert not found.is_damaged("frames", 5)
        assert not found.is_damaged("frames", 1000)
    assert counted == {"frames": 2, "warps/shown": 1, "surface": 2, "pictures": 1}
    assert len(calls) == len(KINDS)
    words = "damaged: 2 frames, 1 shown warp, 2 surfaces, 1 picture's warp left out"
    assert damaged_words(counted) == words


@pytest.mark.parametrize("table", ["steps", "peaks", "presentation_log"])
def test_a_damaged_row_is_left_out_of_its_table_and_counted(table, files, tmp_path):
    path = files["ended"]
    with h5py.File(path, "r") as file:
        row_bytes = file[f"{table}/table"].dtype.itemsize
    # one bit of the third row's last bytes
    content = bytearray(path.read_bytes())
    content[place(path, f"{table}/table") + 3 * row_bytes - 2] ^= 1
    path = tmp_path / "damaged.h5"
    path.write_bytes(content)
    with Recording(path) as found:
        with pytest.warns(DamagedWarning, match=rf"damaged\.h5: {table}/table: damaged: "):
            rows = getattr(found, table)
        if table == "presentation_log":
            # pictures are known by their row's place, which nobody can know after a gap
            assert len(rows) == 2
            assert found.tables.first_unknown_picture() == rows["after_step"][-1]
        else:
            assert list(rows["number" if table == "steps" else "step"]) == [1, 2, *range(4, STEPS + 1)]
            assert found.tables.damaged_steps(table) == {3}
        assert found.damaged() == {table: 1}
        assert found.tables.left_out() == {table: 1}


@pytest.mark.parametrize("changed", [{"depth_mm": 0.4007}, {"depth_mm": np.nan}, {"time_ns": 7}], ids=str)
def test_a_peak_that_contradicts_its_surface_is_left_out(changed, files, tmp_path):
    path = tmp_path / "damaged.h5"
    shutil.copy(files["ended"], path)
    with h5py.File(path, "r+", libver="latest") as file:
        row = file["peaks/table"][4]
        for name, value in changed.items():
            row[name] = value
        file["peaks/table"][4] = row
        sum_again(file)
    with Recording(path) as found:
        assert len(found.peaks) == STEPS
        assert found.damaged() == {"peaks": 1}
        assert list(found.peaks["step"]) == [1, 2, 3, 4, *range(6, STEPS + 1)]


def test_states_and_events_go_by_the_words_in_the_file(files, tmp_path):
    """As in a recording made before a state was added in the middle: another order, and one fewer."""
    path = tmp_path / "before.h5"
    shutil.copy(files["ended"], path)
    words = [state.value for state in State if state is not State.MOVED][::-1]
    with h5py.File(path, "r+", libver="latest") as file:
        for table in ("steps", "peaks"):
            rows = file[f"{table}/table"][()]
            assert set(rows["state"]) == {list(State).index(State.LOCKED)}
            rows["state"] = words.index("locked")
            if table == "steps":
                rows["events"][0] = 1
                file["steps/table"].attrs["events"] = [Event.FRAMES_DROPPED.value, Event.FRAME_LATE.value]
            file[f"{table}/table"][...] = rows
            file[f"{table}/table"].attrs["states"] = words
        sum_again(file)
    with Recording(path) as found:
        assert {found.state_of(row) for row in found.steps} == {State.LOCKED}
        assert set(found.peaks["state"]) == {"locked"}
        assert found.events_of(found.steps[0]) == (Event.FRAMES_DROPPED,)
    with h5py.File(path, "r+", libver="latest") as file:
        file["steps/table"].attrs["states"] = [*words[:-1], "lockee"]
    with Recording(path) as found, pytest.raises(InputError, match="states: 'lockee' is not known: damaged"):
        _ = found.steps


def test_nothing_is_counted_where_nothing_is_damaged(files):
    for path in files.values():
        with Recording(path) as found:
            assert found.damaged() == {}
    assert damaged_words({}) == ""


def test_of_a_recording_that_goes_on_what_is_complete_is_checked(path):
    with recorder(path) as recording, Recording(path) as along:
        for number in range(1, 30):
            recording.add_step(a_step(number))
            along.refresh()
            assert along.damaged() == {}
        eventually(lambda: recording.waiting_bytes == 0)


def test_a_damaged_surface_has_no_valid_node(files, tmp_path):
    path = files["ended"]
    path = damaged(path, tmp_path / "damaged.h5", place(path, "surface/slope", 2) + 64, 8)
    with Recording(path) as found:
        with pytest.warns(DamagedWarning, match="surface/slope"):
            surface = found.surface(3)
        assert surface.time_ns == a_step(3).time_ns
        assert not surface.valid.any()
        assert np.isnan(surface.depth_mm).all()
        assert found.surface(4) is not None


def test_arrays_are_never_given_for_another_step(files, tmp_path):
    path = files["ended"]
    path = damaged(path, tmp_path / "damaged.h5", place(path, "frames/step") + 8, 1)
    with Recording(path) as found:
        with pytest.warns(DamagedWarning, match="frames/step"):
            kept = found.steps_with("frames")
        assert list(kept) == [1, *range(3, STEPS + 1)]
        assert found.image(2) is None
        np.testing.assert_array_equal(found.image(3), a_step(3).image)


def test_a_rest_that_is_damaged_is_refused(files, tmp_path):
    path = files["ended"]
    path = damaged(path, tmp_path / "damaged.h5", place(path, "rest/q") + 800, 1)
    with Recording(path) as found, pytest.raises(InputError, match=r"damaged\.h5: rest/q: damaged"):
        _ = found.rest


def test_where_warnings_are_errors_every_damaged_array_is_one(files, tmp_path):
    path = files["ended"]
    path = damaged(path, tmp_path / "damaged.h5", place(path, "frames/image", 3), 4)
    with Recording(path) as found, warnings.catch_warnings():
        warnings.simplefilter("error", DamagedWarning)
        for _ in range(2):
            with pytest.raises(DamagedWarning):
                found.image(4)


ADD = """
import sys, h5py
with h5py.File(sys.argv[1], "r+", libver="latest", locking=False) as file:
    for name in ("table", "checksums"):
        dataset = file[f"steps/{name}"]
        dataset.resize(len(dataset) + 3, axis=0)
    # rows of zeros
    dataset[-3:] = file["steps/table"].dtype.itemsize
"""


def test_what_is_written_after_a_file_was_opened_whole_is_seen(files, tmp_path):
    path = tmp_path / "more.h5"
    shutil.copy(files["ended"], path)
    with Recording(path) as found:
        assert len(found.steps) == STEPS
        subprocess.run([sys.executable, "-c", ADD, str(path)], timeout=60, check=True)
        found.refresh()
        assert len(found.steps) == STEPS + 3
