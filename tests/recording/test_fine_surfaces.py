import json
import time
import urllib.request
from collections.abc import Callable

import numpy as np
import pytest
import tifffile
from browsing import browser, needs_browser, served, tab

import zeromethod as zm
from benchmarks.rigs import small_rig
from zeromethod.clock import HostClock
from zeromethod.export import prepare
from zeromethod.fine.surface import FineSurface
from zeromethod.operating.player import Player
from zeromethod.operating.readings import Readings
from zeromethod.page.encoding import Encoded
from zeromethod.page.message import Content
from zeromethod.page.replay_content import ReplayContent
from zeromethod.page.run_feed import RunFeed
from zeromethod.recording.recording import Recording

MAPS = ("depth_mm", "slope", "sigma_depth_mm", "sigma_slope", "x_mm", "y_mm", "share")


class NewestOnly:
    """A page that keeps what it was offered last."""

    def draw_by(self, drawing: object) -> None:
        pass

    def offer(self, compose: Callable[[frozenset[str]], Content]) -> None:
        self.newest = compose


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> tuple:
    """(file, fine surfaces that the session gave, what its page was offered with each)."""
    path = tmp_path_factory.mktemp("fine") / "fine.h5"
    rig = small_rig(4).replace(scenario="hold")
    page, found, offered = NewestOnly(), [], []
    with zm.Session(rig, fine=True, record=path) as session:
        readings = Readings(session)
        feed = RunFeed(page, session, readings, HostClock())
        for step in session.run(seconds=1.3):
            readings.see(step)
            feed.see(step, ())
            if step.fine is not None:
                found.append(step.fine)
                offered.append(page.newest(frozenset({"fine"})))
    return path, found, offered


def test_a_recording_gives_back_the_fine_surfaces_that_the_session_gave(recorded):
    path, found, _ = recorded
    with Recording(path) as recording:
        steps = recording.steps_with("fine").tolist()
        assert len(steps) == len(found) > 0
        assert "fine" in recording.kept
        for step, given in zip(steps, found, strict=True):
            read = recording.fine(step)
            assert isinstance(read, FineSurface)
            for name in MAPS:
                # places and shares are kept at the nodes, in single precision: 4 nm at 60 mm
                np.testing.assert_allclose(getattr(read, name), getattr(given, name), rtol=2e-7, atol=1e-6)
            np.testing.assert_array_equal(read.valid, given.valid)
            assert (read.first_px, read.frames, read.time_ns) == (given.first_px, given.frames, given.time_ns)
            assert read.time_ns == recording.row(step)["time_ns"]
            np.testing.assert_allclose(read.coarse.depth_mm, given.coarse.depth_mm, rtol=1e-6)
        peak = recording.fine_peaks[-1]
        assert (peak["depth_mm"], peak["x_mm"], peak["y_mm"]) == pytest.approx(found[-1].peak)
        assert 0 < peak["depth_sigma_mm"] < 0.01 * peak["depth_mm"]
        assert not recording.damaged()


def test_read_again_from_the_same_frames_they_are_the_same_bit_for_bit(recorded):
    path, found, _ = recorded
    figures = zm.replay(path, "from-frames", from_s=0.5)
    # the first is read before that: it is read again for what the reader keeps, but not compared
    assert figures["fine_readings"] == figures["fine_readings_equal"] == len(found) - 1 > 0
    assert figures["fine_depth_difference_nm"] == figures["fine_peak_difference_nm"]
    assert figures["fine_depth_difference_nm"]["largest"] == 0.0
    assert figures["equal"]


def test_a_page_shows_the_newest_one_with_its_time_live_and_of_a_recording(recorded):
    path, found, offered = recorded
    with Recording(path) as recording:
        content = ReplayContent(recording, Player(recording.seconds))
        first = content.index_at(
            1e-9 * float(recording.fine_peaks["time_ns"][0] - recording.steps["time_ns"][0])
        )
        assert content.values(first - 1)["fine_time_s"] is None
        steps, wanted = recording.fine_peaks["step"], frozenset({"fine"})
        again = [
            content.compose(int(np.searchsorted(recording.steps["number"], one)), wanted) for one in steps
        ]
        assert "fine" not in content.compose(first, frozenset({"surface"})).arrays
    for given, live, played in zip(found, offered, again, strict=True):
        np.testing.assert_array_equal(live.arrays["fine"]["depth"], given.depth_mm)
        for name in ("depth", "sigma"):
            np.testing.assert_array_equal(played.arrays["fine"][name], live.arrays["fine"][name])
        names = ("fine_peak_mm", "fine_peak_sigma_mm", "fine_time_s", "fine_doubt")
        assert [played.values[one] for one in names] == [live.values[one] for one in names]
        assert played.meta == live.meta
        assert live.values["fine_time_s"] == live.meta["fine"]["time_s"] == live.values["time_s"]
        assert live.values["fine_doubt"] == live.values["doubt"]
        # where the map is deepest it is marked, at the pixel's own place in the picture
        (u, v), (column, row) = live.meta["fine"]["lattice"]["first"], live.meta["fine"]["peak_node"]
        assert (v, u) == given.first_px
        assert given.depth_mm[row, column] == np.nanmax(given.depth_mm)
    about, data = Encoded(1, wanted, offered[-1]).part("fine_sigma")
    codes = np.frombuffer(data, "<u2").reshape(about["shape"])
    sigma_um = about["maps"]["sigma"]["offset"] + about["maps"]["sigma"]["step"] * codes
    np.testing.assert_allclose(sigma_um, 1e3 * found[-1].sigma_depth_mm, atol=about["maps"]["sigma"]["step"])


@needs_browser
def test_a_browser_draws_every_pixel_when_asked_to_and_not_well_once_it_is_held(recorded, tmp_path):
    with (
        served("replay", recorded[0], "--view", "127.0.0.1:0", cwd=tmp_path, wanted=2) as one,
        browser() as opened,
        tab(opened, one.urls["view"]) as page,
    ):

        def waited(condition: str) -> None:
            end_s = time.monotonic() + 60.0
            while not page.evaluate(condition):
                assert time.monotonic() < end_s, condition
                page.wait_for_timeout(50)

        def at(time_s: float) -> None:
            seek = f"{one.base}/api/seek?token={one.token}"
            urllib.request.urlopen(seek, json.dumps({"time_s": time_s}).encode(), 30)

        urllib.request.urlopen(f"{one.base}/api/pause?token={one.token}", b"{}", 30)
        at(0.3)
        waited("zeromethod.values.time_s < 0.31 && zeromethod.contents > 2")
        waited("document.getElementById('every-pixel').hidden")  # none was read yet
        at(1.0)
        waited("!document.getElementById('every-pixel').hidden")
        page.click("#every-pixel")
        waited("document.getElementById('depth-note').textContent.startsWith('every pixel: peak 199')")
        assert page.is_hidden("#depth .badge")
        at(9.0)
        waited("zeromethod.values.state === 'stopped'")
        waited("document.getElementById('depth').classList.contains('doubted')")
        assert page.inner_text("#depth .badge") == "held: the run has ended"


def test_fine_surfaces_are_exported_as_arrays_lattice_mesh_and_track(recorded, tmp_path):
    path, found, _ = recorded
    deepest_mm = found[-1].peak[0]
    with Recording(path) as recording:
        files = {name: tmp_path / name for name in ("a.npz", "a.tif", "a.ply", "a.csv")}
        exports = {name: prepare(recording, file, fine=True) for name, file in files.items()}
        figures = {name: one.write() for name, one in exports.items()}
        with pytest.raises(zm.InputError, match="mcap has no fine surfaces"):
            prepare(recording, tmp_path / "a.mcap", fine=True)
    with np.load(files["a.npz"]) as data:
        assert data["depth_mm"].shape == (len(found), *found[0].depth_mm.shape)
        np.testing.assert_array_equal(data["depth_mm"][-1], found[-1].depth_mm)
        assert (data["v_px"][0], data["u_px"][0]) == found[0].first_px
    # pixels are 0.2 mm here, resampled by cubics
    assert figures["a.tif"]["pitch_mm"] < 0.3
    assert np.nanmax(tifffile.imread(files["a.tif"])[-1, 0]) == pytest.approx(deepest_mm, rel=2e-3)
    assert figures["a.ply"]["depth_largest_mm"] == pytest.approx(deepest_mm, rel=2e-2)
    lines = files["a.csv"].read_text().splitlines()
    assert len(lines) == 1 + len(found) == 1 + len(exports["a.csv"].selected.steps)
    assert float(lines[-1].split(",")[1]) == pytest.approx(deepest_mm)


def test_the_report_shows_every_pixel(recorded, tmp_path):
    path, found, _ = recorded
    figures = zm.report(path, tmp_path / "page.html")
    assert figures["fine"]["surfaces"] == len(found)
    largest = figures["fine"]["largest"]["depth_mm"]
    assert abs(largest) >= abs(figures["fine"]["depth_mm"])
    assert f"{1e3 * largest:.4f}" in (tmp_path / "page.html").read_text()
    assert "every pixel" in (tmp_path / "page.html").read_text()
