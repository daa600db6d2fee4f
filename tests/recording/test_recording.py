"""What was recorded is what was measured."""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import pytest
from recorded_run import recorded, small_rig

from zeromethod import InputError, Loop, Optics, Peak, Recording, Step, Surface, SurfaceReader
from zeromethod.recording.opening import Refusal, RefusedRecording
from zeromethod.recording.schema import KEEP
from zeromethod.session.dirt import DirtCorrection


@dataclass
class Truth:
    """A recorded run, and what it was made of."""

    path: Path
    steps: list[Step] = field(default_factory=list)
    readings: dict[int, tuple[Surface, Peak]] = field(default_factory=dict)

    def take(self, _: Loop, step: Step) -> None:
        self.steps.append(step)

    def read(self, step: Step, surface: Surface, peak: Peak) -> None:
        self.readings[step.number] = surface, peak


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Truth:
    truth = Truth(tmp_path_factory.mktemp("recorded") / "run.h5")
    recorded(truth.path, 0.4, on_step=truth.take, on_reading=truth.read)
    return truth


@pytest.fixture
def opened(truth: Truth) -> Iterator[Recording]:
    with Recording(truth.path) as recording:
        yield recording


def test_what_replay_needs_is_there_bit_for_bit(truth, opened):
    assert len(truth.steps) > 15
    measured = 0
    for step in truth.steps:
        frame = opened.frame(step.number)
        if step.image is None:
            assert frame is None
            continue
        assert frame.image.dtype == step.image.dtype
        np.testing.assert_array_equal(frame.image, step.image)
        assert (frame.time_ns, frame.exposure_ns) == (step.time_ns, step.exposure_ns)
        assert (frame.number, frame.dropped) == (step.frame_number, step.dropped)
        warp = opened.measured(step.number)
        if step.measured is None:
            assert warp is None
            continue
        measured += 1
        assert warp.q.tobytes() == step.measured.q.tobytes()
        assert warp.sigma.tobytes() == step.measured.sigma.tobytes()
        assert warp.flags.tobytes() == step.measured.flags.tobytes()
        assert warp.time_ns == step.measured.time_ns
    assert measured > 10


def test_all_pictures_are_there_with_their_warps(truth, opened):
    shown = [
        (one, step.number - (index < step.presented_before))
        for step in truth.steps
        for index, one in enumerate(step.presented)
    ]
    assert len(shown) > 5
    rows = opened.presentation_log[: len(shown)]
    for index, ((one, after), row) in enumerate(zip(shown, rows, strict=True)):
        assert (row["time_ns"], row["after_step"]) == (one.time_ns, after)
        assert row["newest_frame_ns"] == (-1 if one.source_ns is None else one.source_ns)
        q = opened.picture_q(index)
        assert q.tobytes() == one.q.tobytes()


def test_the_rest_is_as_single_precision_has_it(truth, opened):
    for step in truth.steps:
        if step.residual is None or step.shown.q is None:
            continue
        residual = opened.residual(step.number)
        np.testing.assert_array_equal(residual.d, step.residual.d.astype(np.float32))
        np.testing.assert_array_equal(residual.sigma, step.residual.sigma.astype(np.float32))
        np.testing.assert_array_equal(residual.flags, step.residual.flags)
        np.testing.assert_array_equal(residual.mean, step.residual.mean)
        np.testing.assert_array_equal(opened.shown(step.number), step.shown.q.astype(np.float32))
        np.testing.assert_array_equal(opened.commanded(step.number), step.commanded.q.astype(np.float32))
    for number, (surface, _) in truth.readings.items():
        found = opened.surface(number)
        for name in ("depth_mm", "slope", "points_mm", "sigma_depth_mm", "sigma_slope"):
            np.testing.assert_array_equal(getattr(found, name), getattr(surface, name).astype(np.float32))
        np.testing.assert_array_equal(found.valid, surface.valid)
        np.testing.assert_array_equal(found.anchor.mask, surface.anchor.mask)
        assert (found.anchor.mode, found.time_ns) == (surface.anchor.mode, surface.time_ns)


def test_steps_keep_figures_states_and_words(truth, opened):
    assert opened.complete
    # and how it ended
    assert len(opened.steps) == len(truth.steps) + 1
    assert opened.state_of(opened.steps[-1]).value == "stopped"
    for step, row in zip(truth.steps, opened.steps, strict=False):
        assert row["number"] == step.number
        assert opened.state_of(row) is step.state
        assert set(opened.events_of(row)) == set(step.events)
        assert opened.text(row["reason"]) == step.reason
        np.testing.assert_equal(row["residual_rms_px"], step.residual_rms_px)
    peaks = {int(row["step"]): row for row in opened.peaks}
    assert peaks.keys() == truth.readings.keys()
    steps = {step.number: step for step in truth.steps}
    start_ns = truth.steps[0].time_ns
    for number, (_, peak) in truth.readings.items():
        row = peaks[number]
        assert (row["depth_mm"], row["depth_sigma_mm"]) == (peak.depth_mm, peak.sigma_mm)
        assert (row["possibly_deeper_mm"], row["x_mm"], row["y_mm"]) == (peak.deeper_mm, peak.x_mm, peak.y_mm)
        assert (row["state"], row["time_ns"]) == (steps[number].state.value, steps[number].time_ns)
        assert row["time_s"] == pytest.approx(1e-9 * (steps[number].time_ns - start_ns), abs=1e-12)


def test_a_recording_describes_itself_in_one_line(truth, opened):
    frames = sum(step.frame_number is not None for step in truth.steps)
    seconds = f"{opened.seconds:.1f} s, {frames} frames"
    assert repr(opened) == f"<Recording {truth.path}: {seconds}, rig simulated, complete>"


def test_rig_and_rest_are_those_of_the_run(opened):
    rig = small_rig()
    assert opened.rig == rig
    assert opened.live is False
    assert opened.seed == rig.simulation.seed
    assert opened.versions.keys() >= {"python", "numpy", "hdf5"}
    assert opened.versions["h5py"] == h5py.version.version
    reader = SurfaceReader(opened.rig, Optics(opened.rig), opened.grid)
    dirt = DirtCorrection(opened.rest.q)
    for number in opened.steps_with("surface"):
        warp = opened.measured(int(number))
        assert warp is not None
        cleaned = dirt.corrected(warp, opened.state_of(opened.row(int(number))), opened.zero(int(number)))
        again = reader.follow(cleaned)  # what presses is learned from frames before
    then = opened.surface(int(number))
    # a reader of its own: the same but for the noise's weighting, which earlier frames settle
    np.testing.assert_allclose(again.depth_mm, then.depth_mm, atol=1e-5)


def test_every_dataset_states_its_units_and_meaning(truth):
    silent: list[str] = []
    tables: list[str] = []

    def look(name: str, one: h5py.Group | h5py.Dataset) -> None:
        if isinstance(one, h5py.Dataset):
            if not one.attrs.get("meaning") or "units" not in one.attrs:
                silent.append(name)
            if one.dtype.names:
                tables.append(name)
                fields = [words.split(" ")[0] for words in one.attrs["fields"]]
                assert fields == list(one.dtype.names)
            if name.endswith(("/q", "_mm")):
                assert one.attrs["units"] in {"LCD px", "mm"}

    with h5py.File(truth.path, "r", swmr=True) as file:
        file.visititems(look)
        assert list(file["steps/table"].attrs["states"])[:2] == ["starting", "resting"]
    assert not silent
    assert sum(name.endswith("/table") for name in tables) == 13
    assert sum(name.endswith("/checksums") for name in tables) == 20


def test_a_frame_is_one_chunk(truth):
    with h5py.File(truth.path, "r", swmr=True) as file:
        frames = file["frames/image"]
        assert frames.chunks == (1, *frames.shape[1:])
        assert frames.id.get_num_chunks() == len(frames)


@pytest.mark.parametrize("keep", [("frames",), ("surface",), ()])
def test_only_what_is_asked_for_is_kept(path, keep):
    path = recorded(path, 0.15, keep=keep)
    with Recording(path) as found:
        assert found.kept == set(keep)
        number = int(found.peaks["step"][-1])
        kept = (found.image(number), found.surface(number), found.residual(number), found.measured(number))
        assert [array is not None for array in kept] == ["frames" in keep, "surface" in keep, False, False]
        assert len(found.steps) > 5
        assert found.picture_q(0) is None


def test_arrays_of_every_third_step(path):
    path = recorded(path, 0.25, every=3)
    with Recording(path) as found:
        assert list(np.diff(found.steps["number"])) == [1] * (len(found.steps) - 1)
        for group in ("frames", "surface"):
            kept = found.steps_with(group)
            assert len(kept) > 2
            assert set((kept - 1) % 3) == {0}
        assert len(found.presentation_log) > 3
        assert found.picture_q(0) is None


def test_compressed_it_is_the_same(path, truth):
    path = recorded(path, 0.15, compress=True)
    with Recording(path) as found, Recording(truth.path) as plain:
        for number in found.steps_with("warps/measured"):
            one, other = found.measured(number), plain.measured(number)
            assert one.q.tobytes() == other.q.tobytes()
            np.testing.assert_array_equal(found.image(number), plain.image(number))
        count = len(found.steps_with("frames"))
    with h5py.File(path, "r", swmr=True) as file:
        frames = file["frames/image"]
        # shot noise leaves little to be had
        assert frames.id.get_storage_size() < 0.97 * count * frames[0].nbytes


def _changed(truth: Truth, path: Path, **attributes: object) -> Path:
    shutil.copy(truth.path, path)
    with h5py.File(path, "r+") as file:
        for name, value in attributes.items():
            file.attrs[name] = value
    return path


@pytest.mark.parametrize("share", [0.9999, 0.5, 0.001, 0.000005])
def test_a_file_that_was_cut_short_is_refused_at_once(share, truth, tmp_path):
    whole = truth.path.read_bytes()
    path = tmp_path / "cut.h5"
    path.write_bytes(whole[: max(int(share * len(whole)), 20)])
    with pytest.raises(InputError, match=r"cut short, \d+ bytes are missing"):
        Recording(path)


def test_another_schema_is_refused_with_a_clear_word(truth, tmp_path):
    path = _changed(truth, tmp_path / "first.h5", schema_version=1, zeromethod_version="0.1.0")
    with pytest.raises(RefusedRecording) as refused:
        Recording(path)
    assert refused.value.refusal is Refusal.OTHER_FORMAT
    assert str(refused.value) == (
        f"{path}: recorded in format 1 by zeromethod 0.1.0; this version reads format 3: "
        "open it with zeromethod 0.1.0"
    )


def test_what_is_no_recording_is_refused(truth, tmp_path):
    with pytest.raises(InputError, match="no recording of zeromethod"):
        Recording(_changed(truth, tmp_path / "other.h5", schema="something else"))
    text = tmp_path / "text.h5"
    text.write_text("no HDF5")
    with pytest.raises(InputError, match="cannot be read as a recording"):
        Recording(text)
    with pytest.raises(InputError, match="not there: give the path"):
        Recording(tmp_path / "missing.h5")


def test_a_file_that_the_rig_names_comes_along(tmp_path):
    press = tmp_path / "mine.toml"
    press.write_text(
        '[[press]]\nshape="load"\nwidth_mm=3.5\npath=[{time_s=0.0,x_mm=42.0,y_mm=0.0,depth_mm=0.1}]\n'
    )
    path = recorded(tmp_path / "run.h5", 0.1, rig=small_rig(press=str(press)))
    text = press.read_text()
    press.unlink()
    with Recording(path) as found:
        assert Path(found.rig.scenario).read_text() == text
        folder = Path(found.rig.scenario).parent
    assert not folder.exists()


def test_the_documented_examples_read_a_recording(truth, tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "recording.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 2
    shutil.copy(truth.path, tmp_path / "session.h5")
    printed = [
        subprocess.run(
            [sys.executable, "-c", block],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        ).stdout
        for block in blocks
    ]
    assert "simulated" in printed[0]
    assert "of (256, 320) grey levels" in printed[1]
    assert "first: starting" in printed[1]


def test_keep_names_are_checked(path):
    with pytest.raises(InputError, match=f"'warp': of {', '.join(KEEP)}"):
        recorded(path, 0.1, keep=("warp",))
