"""Recorded frames through the loop's own circle again."""

import re
from pathlib import Path

import numpy as np
import pytest
from recorded_run import recorded
from small_rigs import with_tables

from benchmarks.against_peers.open_loop import coarser
from zeromethod import InputError, Loop, Optics, Recording, load_rig, open_devices
from zeromethod.clock import HostClock
from zeromethod.recording import DamagedWarning
from zeromethod.recording.recorder import Recorder
from zeromethod.session.replay.from_frames import replay_from_frames
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.window import Window


def assert_all_equal(path: Path, least: int) -> None:
    with Recording(path) as opened:
        warps, depths, _ = replay_from_frames(opened, opened.rig, Window.of(opened))
    assert warps.steps >= least
    assert warps.different == []
    assert depths.different == []


def test_unchanged_frames_come_to_the_recorded_numbers_bit_for_bit(session, recording):
    warps, depths, _ = replay_from_frames(recording, recording.rig, Window.of(recording))
    sensed = [step for step in session.steps if step.sensed]
    assert warps.steps == len(sensed) > 40
    assert warps.different == []
    assert any(step.frozen for step in sensed)
    assert depths.steps == len(session.readings)
    assert depths.different == []
    assert warps.warp.largest == warps.commanded.largest == warps.residual.largest == 0.0


def test_frames_that_were_faulty_and_a_new_zero_are_gone_through_alike(session, tmp_path):
    faults = session.rig.simulation.faults.model_copy(
        update={"repeat_frames": (12,), "drop_frames": (15, 16), "light_off_frames": (8, 9)}
    )
    rig = with_tables(session.rig, scenario="none", simulation={"faults": faults})
    zeros = []

    def on_step(loop: Loop, step: object) -> None:
        if loop.status.nulled_frames == 3 and loop.zero is None:
            loop.rezero()
        zeros.append(loop.zero)

    path = recorded(tmp_path / "r.h5", 0.7, rig=rig, on_step=on_step)
    assert zeros[-1] is not None
    with Recording(path) as opened:
        assert not opened.steps["sensed"].all()
    assert_all_equal(path, 30)


def test_coded_strips_and_the_shifts_of_a_moving_target_are_read_again(tmp_path):
    settings = ["control.strips=edges", "scenario=step", "target.step=16"]
    rig = with_settings(coarser(load_rig("simulated"), 4), settings)
    path = recorded(tmp_path / "r.h5", 0.25, rig=rig)
    with Recording(path) as opened:
        assert opened.presentation_log["strip_code"].max() > 0
        steps = np.diff(opened.presentation_log["target_shift"], axis=0)
        np.testing.assert_allclose(np.abs(steps), np.tile([1 / 16, 2 / 16], (len(steps), 1)))
    assert_all_equal(path, 10)


def test_a_session_in_real_time_is_gone_through_in_its_own_order(session, tmp_path):
    rig = with_tables(session.rig, simulation={"renderer": "numpy"})
    path, optics = tmp_path / "r.h5", Optics(rig)
    with (
        open_devices(rig, HostClock()) as devices,
        Loop(rig, devices.camera, devices.display, devices.clock, optics=optics) as loop,
        Recorder(path, rig, loop.rest, live=True) as recorder,
    ):
        # frames, not seconds: however slow the machine is
        for step in loop.run(frames=12):
            recorder.add_step(step)
    # on a busy machine the loop may hold back some for their age
    assert_all_equal(path, 3)


def test_more_noise_makes_sigma_larger_and_leaves_the_warps(recording):
    rig = with_settings(recording.rig, ["camera.noise.read_grey=8.0", "camera.noise.electrons_per_grey=1e9"])
    warps, *_ = replay_from_frames(recording, rig, Window.of(recording, 0.4, 0.5))
    sigmas = warps.figures["sigma_lcd_px"]
    assert sigmas["replayed"] > 2 * sigmas["recorded"]
    # sigma weighs what the controller learns, and matching starts from that: 1.2e-3 px at one node here
    assert warps.warp.largest < 5e-3
    assert len(warps.different) == warps.steps


def test_a_part_is_sensed_as_within_the_whole(recording):
    warps, depths, _ = replay_from_frames(recording, recording.rig, Window.of(recording, 0.5, 0.7))
    assert 10 < warps.steps < 15
    assert warps.different == depths.different == []


@pytest.mark.parametrize(
    ("keep", "every", "word"),
    [(("warps",), 1, "recorded without frames"), (("frames", "warps"), 2, "only every 2th frame")],
)
def test_what_is_missing_is_reported_in_one_line(session, tmp_path, keep, every, word):
    path = recorded(tmp_path / "r.h5", 0.15, rig=session.rig, keep=keep, every=every)
    with Recording(path) as opened, pytest.raises(InputError, match=word) as caught:
        replay_from_frames(opened, opened.rig, Window.of(opened))
    assert "\n" not in str(caught.value)


def test_a_frame_that_was_not_kept_ends_what_can_be_sensed(session, tmp_path, monkeypatch):
    with Recording(session.path) as opened:
        missing = int(opened.steps["number"][20])
        whole = opened.frame
        monkeypatch.setattr(opened, "frame", lambda step: None if step == missing else whole(step))
        with pytest.raises(InputError, match=f"the frame of step {missing} .* was not kept"):
            replay_from_frames(opened, opened.rig, Window.of(opened))
        before_s = 1e-9 * float(opened.steps["time_ns"][19] - opened.steps["time_ns"][0])
        warps, *_ = replay_from_frames(opened, opened.rig, Window.of(opened, None, before_s + 1e-6))
    assert warps.different == []


@pytest.mark.parametrize("name", ["pictures/q", "frames/image"])
def test_what_is_damaged_ends_what_can_be_sensed_and_is_not_called_unkept(session, damaged, name):
    step = session.steps[25].number
    with Recording(session.path) as opened:
        after = opened.presentation_log["after_step"]
    pictures = name == "pictures/q"
    path = damaged(name, int(np.flatnonzero(after == step - 1)[0]) if pictures else step)
    words = f"what was shown before step {step}" if pictures else f"the frame of step {step} "
    with (
        Recording(path) as opened,
        pytest.warns(DamagedWarning),
        pytest.raises(InputError, match=f"{re.escape(words)}.* is damaged: .*--to") as caught,
    ):
        replay_from_frames(opened, opened.rig, Window.of(opened))
    assert "not kept" not in str(caught.value)
    # up to where it says, it can
    found = re.search(r"--to ([0-9.]+)", str(caught.value))
    with Recording(path) as opened:
        warps, *_ = replay_from_frames(opened, opened.rig, Window.of(opened, None, float(found[1])))
    assert warps.steps > 15
    assert warps.different == []


def test_where_the_first_picture_is_damaged_nothing_can_be_sensed(damaged):
    with (
        Recording(damaged("pictures/q", 0)) as opened,
        pytest.warns(DamagedWarning),
        pytest.raises(InputError, match=r"is damaged: it cannot be replayed from frames$"),
    ):
        replay_from_frames(opened, opened.rig, Window.of(opened))


def test_recorded_warps_that_are_damaged_are_no_difference(session, damaged):
    step = list(session.readings)[4]
    with Recording(damaged("warps/measured/q", step)) as opened, pytest.warns(DamagedWarning):
        warps, *_ = replay_from_frames(opened, opened.rig, Window.of(opened, None, 0.4))
    assert warps.figures["warps_damaged"] == 1
    assert warps.different == []
