"""The loop closed again over the mirror of a recording."""

from types import SimpleNamespace

import numpy as np
import pytest

from zeromethod import Recording, load_rig
from zeromethod.session.replay.closed_loop import ClosedLoopReplay, recorded_track, simulated_bench
from zeromethod.session.replay.comparison import figures_of
from zeromethod.session.replay.from_frames import replay_from_frames
from zeromethod.session.replay.mirror import RecordedMirror, contacts_left_out
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.track import Track
from zeromethod.session.replay.window import Window


def closed_loop(
    recording: Recording, settings: list[str], window: Window | None = None, **more: object
) -> Track:
    mirror = RecordedMirror(recording, window or Window.of(recording))
    rig = with_settings(simulated_bench(recording.rig), settings)
    return ClosedLoopReplay("simulated", rig, mirror, **more).run()


@pytest.fixture(scope="module")
def unchanged(session) -> Track:
    with Recording(session.path) as recording:
        return closed_loop(recording, [])


@pytest.fixture(scope="module")
def was(session) -> Track:
    with Recording(session.path) as recording:
        return recorded_track(recording, Window.of(recording))


def test_the_mirror_is_where_it_was_read(session, recording):
    window = Window.of(recording)
    mirror = RecordedMirror(recording, window)
    scenario = mirror.scenario("again")
    for step in recording.steps_with("surface")[[5, 20, 35, 45]]:
        surface = recording.surface(int(step))
        there = scenario.mirror_at(surface.time_ns - mirror.shift_ns)
        off = there.depth(surface.x_mm, surface.y_mm)[surface.valid] - surface.depth_mm[surface.valid]
        # 0.3 um is what the noise of one frame is on these few nodes, and 0.5 that of the constant while it
        # is learned what presses; a sixteenth of it is averaged away
        assert np.sqrt(np.mean(off**2)) < 1.5e-3


def test_at_rest_the_noise_of_single_readings_does_not_move_it(session, recording):
    mirror = RecordedMirror(recording, Window.of(recording))
    scenario = mirror.scenario("again")
    steps = [int(step) for step in recording.steps_with("surface")]
    surfaces = [recording.surface(step) for step in steps]
    still = [surface for surface in surfaces if surface.time_ns < 0.13e9]
    assert len(still) >= 5
    valid = np.logical_and.reduce([surface.valid for surface in still])
    x_mm, y_mm = still[0].x_mm[valid], still[0].y_mm[valid]
    read = np.std([surface.depth_mm[valid] for surface in still], axis=0)
    moved = np.std([scenario.mirror_at(s.time_ns - mirror.shift_ns).depth(x_mm, y_mm) for s in still], axis=0)
    assert np.mean(moved) < 0.5 * np.mean(read)


def test_contacts_of_the_window_that_the_mirror_has_not_are_counted():
    rows = np.zeros(5, [("id", int), ("time_ns", int)])
    rows["id"], rows["time_ns"] = [1, 1, 2, 3, 3], [10, 20, 20, 40, 50]
    recording = SimpleNamespace(contacts=rows)
    assert contacts_left_out(recording, Window(0, 15, 40, False)) == 3
    assert contacts_left_out(recording, Window(0, 41, 60, False)) == 1
    assert contacts_left_out(recording, Window(0, 60, 70, False)) == 0


def test_unchanged_it_does_what_the_session_did(was, unchanged):
    recorded_figures, again = figures_of(was), figures_of(unchanged)
    assert again["frames"] == recorded_figures["frames"]
    assert again["depth_peak_mm"] == pytest.approx(0.1, rel=0.1)
    # the mirror has the noise of its readings on top while it moves
    assert again["residual_rms_px"] == pytest.approx(recorded_figures["residual_rms_px"], rel=0.25)
    assert again["lag_ms"] == pytest.approx(recorded_figures["lag_ms"], abs=6.0)
    # until it is learned what presses the border counts as at rest: 11 um of 100 here
    assert again["depth_error_um"] < 15.0


def test_the_same_seed_is_the_same_session_bit_for_bit(session, recording, unchanged):
    again = closed_loop(recording, [])
    assert len(again.points) == len(unchanged.points)
    assert np.array_equal(again.moved, unchanged.moved, equal_nan=True)
    assert np.array_equal(again.behind, unchanged.behind, equal_nan=True)
    for name in ("residual_rms_px", "depth_peak_mm", "depth_error_um"):
        assert np.array_equal(again.values(name), unchanged.values(name), equal_nan=True)


def test_a_later_panel_lags_more_and_rejects_less(recording, unchanged):
    slow = figures_of(closed_loop(recording, ["display.latency_s=0.03"]))
    known = figures_of(unchanged)
    # a quarter is left of 30 ms by the command's lead, which a press of 0.2 s cannot use in full
    assert 8.0 < slow["lag_ms"] - known["lag_ms"] < 40.0
    assert slow["left_by_hz"]["2-4"] > 1.2 * known["left_by_hz"]["2-4"]


def test_a_timid_integrator_nulls_the_same_mirror_worse(recording, unchanged):
    timid = figures_of(closed_loop(recording, ["control.controller=integrator", "control.gain=0.1"]))
    assert timid["residual_rms_px"] > 1.5 * figures_of(unchanged)["residual_rms_px"]
    assert timid["nulled_share"] < figures_of(unchanged)["nulled_share"]


def test_a_part_begins_locked_though_the_mirror_is_pressed(recording):
    # pressed down at 0.35 s, held until 0.55 s
    track = closed_loop(recording, [], Window.of(recording, 0.46, 0.54))
    assert len(track.points) >= 4
    assert all(point.nulled for point in track.points)
    assert track.values("depth_peak_mm") == pytest.approx(0.1, rel=0.1)
    assert 0 <= track.time_s[0] < 0.02


def test_it_can_be_recorded_and_that_sensed_again(recording, tmp_path, unchanged):
    path = tmp_path / "again.h5"
    closed_loop(recording, [], Window.of(recording, None, 0.3), record=path, command_line="replay")
    with Recording(path) as again:
        assert again.complete
        assert again.rig.scenario == "none"
        warps, depths, _ = replay_from_frames(again, again.rig, Window.of(again))
        assert warps.steps > 10
        assert warps.different == depths.different == []
        assert recorded_track(again, Window.of(again)).values("residual_rms_px")[3:15] == pytest.approx(
            unchanged.values("residual_rms_px")[3:15]
        )


def test_a_real_bench_becomes_a_simulated_one_with_its_delays():
    rig = with_settings(
        load_rig("simulated"),
        [
            "display.driver=window",
            "display.monitor=1",
            "display.latency_s=0.02",
            "camera.driver=aravis",
            "camera.latency_s=0.011",
            "simulation.camera_latency_s=0.004",
            "scenario=step",
        ],
    )
    bench = simulated_bench(rig)
    assert (bench.display.driver, bench.camera.driver) == ("simulated", "simulated")
    assert bench.display.latency_s == 0.02
    assert bench.simulation.camera_latency_s == 0.011
    assert bench.scenario == "none"
    # a window and a camera have coded strips by themselves, which the simulated ones have on request
    assert bench.control == rig.control.model_copy(update={"strips": "edges"})
