"""The MP4 as PyAV, and ffprobe where it is installed, reads it back."""

import itertools
import json
import shutil
import subprocess
from pathlib import Path

import av
import numpy as np
import pytest

from zeromethod.export import Selection, prepare
from zeromethod.export.lattice import MapLattice
from zeromethod.export.picture import Picture, Scales
from zeromethod.recording.recording import Recording

GREY = 191
"""Level of what was not measured."""


def frames_of(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as file:
        return [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]


@pytest.fixture(scope="module")
def video(planted, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    path = tmp_path_factory.mktemp("video") / "a.mp4"
    with Recording(planted.path) as recording:
        return path, prepare(recording, path).write()


def test_the_video_keeps_the_recordings_pace(video):
    path, figures = video
    # Steps 2 to 9 are 0.02 to 0.22 s: 11 frames of 20 ms, the 3 that are missing shown as the one before.
    assert (figures["frames"], figures["rate_hz"]) == (11, pytest.approx(50.0))
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        assert float(stream.average_rate) == pytest.approx(50.0)
        assert (stream.height, stream.width) == (figures["rows"], figures["columns"])
        times = [frame.time for frame in file.decode(stream)]
    assert times == pytest.approx(0.02 * np.arange(11), abs=1e-4)
    frames = [frame.astype(int) for frame in frames_of(path)]
    change = [np.abs(after - before).max() for before, after in itertools.pairwise(frames)]
    # Encoding alone changes a still picture by a few levels; text and dent change by far more.
    assert max(change[4:7]) < 60
    assert min(change[:4] + change[7:]) > 100


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="ffprobe (package ffmpeg) is not installed")
def test_ffprobe_reads_it(video):
    path, figures = video
    probe = subprocess.run(
        ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json", path],
        capture_output=True,
        check=True,
    )
    assert probe.stderr == b""
    (stream,) = json.loads(probe.stdout)["streams"]
    assert (stream["codec_type"], stream["pix_fmt"], stream["r_frame_rate"]) == ("video", "yuv420p", "50/1")
    assert int(stream["nb_read_frames"]) == figures["frames"]
    assert float(stream["duration"]) == pytest.approx(figures["length_s"], abs=1e-3)


def test_one_frame_is_a_video_as_well(recording, tmp_path):
    prepare(recording, tmp_path / "a.mp4", selection=Selection(from_s=0.1, to_s=0.1)).write()
    assert len(frames_of(tmp_path / "a.mp4")) == 1


def test_panels_show_the_frame_the_residual_and_the_dent_in_its_place(planted, recording):
    surface, inner = recording.surface(9), recording.grid.inner
    x_mm, y_mm = surface.x_mm[inner], surface.y_mm[inner]
    lattice = MapLattice.covering(x_mm, y_mm)
    picture = Picture(recording.grid, lattice, Scales(150.0, (0.01, 1.0), 0.2))
    dark, bright = (np.full((256, 320), level, np.uint8) for level in (0, 150))
    camera, _, depth = picture.places
    nothing = picture.draw(dark, None, None, "")
    shown = picture.draw(bright, recording.residual(9), surface, "")
    assert (nothing[camera] == 0).all()
    assert (shown[camera] == 255).all()
    assert (nothing[depth] == GREY).all()
    # Red where the rubber is pressed in, by far most of all at the dent's middle, white far from it.
    red = shown[depth][..., 0].astype(int) - shown[depth][..., 2]
    rows, cols = red.shape
    red_there = red > 0.9 * red.max()
    j, i = (float(axis.mean()) for axis in np.nonzero(red_there))
    x = lattice.x0_mm + lattice.pitch_mm * ((i + 0.5) / cols * lattice.shape[1] - 0.5)
    # x grows to the right, y upwards
    y = lattice.y0_mm + lattice.pitch_mm * ((1.0 - (j + 0.5) / rows) * lattice.shape[0] - 0.5)
    assert (x, y) == pytest.approx((42.0, 3.0), abs=0.5 * lattice.pitch_mm)
    # The unread nodes are grey on the map, the padding round the nodes is on the camera's.
    assert (shown[depth] == GREY).all(axis=-1).any()


def test_scales_hold_the_largest_peak_and_whole_decades_of_residual():
    image = np.tile(np.arange(200, dtype=np.uint16), (100, 1))
    scales = Scales.of([image], np.array([np.nan, 0.02, 0.03, 4.0]), np.array([np.nan, -0.05, 0.02]))
    assert scales.grey == pytest.approx(199, abs=1)
    assert scales.residual_px == pytest.approx((0.01, 10.0))
    assert scales.depth_mm == pytest.approx(0.05)
