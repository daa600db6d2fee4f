"""Passive runs: one picture stays, on the LCD or printed, and depth is read as an open loop can."""

from __future__ import annotations

import time

import numpy as np
import pytest
from small_rigs import quarter

import zeromethod as zm
from zeromethod.cli.output import write_picture
from zeromethod.clock import HostClock
from zeromethod.devices.protocols import Frame
from zeromethod.drivers.blank import BlankDisplay
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import State
from zeromethod.pattern.printed import MARGIN_MM, bar_mm, printed_pattern, printed_sheet
from zeromethod.rig.model import Rig
from zeromethod.session.replay.from_frames import replay_from_frames
from zeromethod.session.replay.window import Window

FRAMES = 40


@pytest.fixture(scope="module")
def passive() -> Rig:
    return quarter(
        display={"columns": 480, "rows": 270, "pitch_mm": 0.252}, control={"controller": "passive"}
    )


@pytest.fixture(scope="module")
def kept(passive, tmp_path_factory):
    """A run, recorded: its session's figures, steps and file."""
    path = tmp_path_factory.mktemp("passive") / "run.h5"
    with zm.Session(passive, record=path) as session:
        steps = list(session.run(frames=FRAMES))
    return session.figures, steps, path


def test_the_picture_stays_and_depth_is_within_its_sigma(kept, passive):
    figures, steps, _ = kept
    rest_q = steps[0].commanded.q
    assert all(step.commanded.q is rest_q for step in steps)
    assert sum(len(step.presented) for step in steps) == 1
    assert {step.state for step in steps if step.phase == "hold"} == {State.PASSIVE}
    assert State.RESTING in {step.state for step in steps if step.phase == "untouched"}
    truth = figures["truth"]
    # the window hides (P^2 - 1) / 12 px^2 of the Laplacian at the peak, 2 / sigma^2 of the depth each way
    pixel_mm = np.ptp(steps[-1].surface.x_mm[20]) / (passive.camera.columns - 16)
    hidden_percent = 100 * (16**2 - 1) / 12 * 2 * (pixel_mm / 5.0) ** 2
    # when it is learned what presses
    late_percent = 100 * (np.mean([step.peak.depth_mm for step in steps[-4:]]) / 0.2 - 1)
    assert -1.5 * hidden_percent < late_percent < 0.0
    # frames before that are in the mean, and in it alone
    assert truth["depth_peak_error_mean_percent"] < late_percent
    assert abs(truth["depth_peak_error_percent"]) < 3 * truth["depth_peak_error_sigma_percent"]
    assert figures["not_nulled"] is None
    assert figures["state"] == "passive"


def test_a_bench_that_moves_is_named_though_nothing_nulls_its_picture(passive):
    # half a camera px: of the mirror's depth, over ten times the stated sigma
    faults = {"moved_at_frame": 12, "camera_turned_deg": (0.0127, 0.0, 0.0)}
    moved = passive.replace({"scenario": "none"}).replace(
        {f"simulation.faults.{key}": value for key, value in faults.items()}
    )
    with zm.Session(moved) as session:
        steps = list(session.run(frames=30))
    assert all(step.state is not State.MOVED for step in steps if (step.frame_number or 0) < 12)
    # the mean of eight frames is judged
    assert [step.state for step in steps[-9:]] == [State.MOVED] * 9


def test_a_recording_of_it_replays_bit_for_bit(kept, passive):
    _, _, path = kept
    with zm.open_recording(path) as recording:
        warps, depths, _ = replay_from_frames(recording, recording.rig, Window.of(recording))
    assert warps.figures["steps_equal"] == warps.figures["steps"] > 0
    assert depths.figures["readings_equal"] == depths.figures["readings"] > 0


class PrintedBench:
    """A camera in the host's time that sees a printed pattern: frames of a passive run, one after another."""

    bits = 8

    def __init__(self, images: list[np.ndarray]) -> None:
        self.shape = images[0].shape
        self._images, self._number = images, -1

    def read(self, timeout_s: float) -> Frame:
        time.sleep(min(0.03, timeout_s))
        self._number = min(self._number + 1, len(self._images) - 1)
        return Frame(self._images[self._number], time.monotonic_ns() - 5_000_000, 8_000_000, self._number)

    def close(self) -> None:
        pass


def test_a_camera_alone_reads_a_printed_pattern(kept, passive):
    _, steps, _ = kept
    seen = [step for step in steps if step.sensed and step.measured is not None]
    display = BlankDisplay(480, 270, 60.0)
    with Loop(passive, PrintedBench([step.image for step in seen]), display, HostClock()) as loop:
        *_, last = (step for step in loop.run(frames=len(seen)) if step.measured is not None)
    assert last.state is State.PASSIVE
    # frames that came too fast are dropped, so that the last may be the one before the last
    held = [step.measured for step in seen if step.phase == "hold"]
    both = last.measured.valid & held[-1].valid
    apart = (last.measured.q - held[-1].q)[both]
    # noise of two frames: 0.02 LCD px each
    assert np.sqrt(np.mean(apart**2)) < 0.05


def test_the_printed_pattern_is_the_picture_at_rest_at_its_true_size(passive, tmp_path):
    image = printed_pattern(passive)
    dots_per_inch = write_picture("--pattern", tmp_path / "print.png", image, passive.display.pitch_mm)
    assert image.shape == (270, 480)
    assert dots_per_inch == pytest.approx(25.4 / 0.252)
    # crossed cosines of contrast 0.9 round mean 0.5, by the curve of sRGB, near a power of 2.2
    light = (image / 255.0) ** 2.2
    assert light.mean() == pytest.approx(0.5, abs=0.01)
    assert (light.min(), light.max()) == pytest.approx((0.05, 0.95), abs=0.02)


def test_the_sheet_has_the_pattern_unchanged_and_a_bar_of_the_length_that_it_states():
    pattern, pitch_mm = np.full((270, 480), 128, np.uint8), 0.252
    sheet = printed_sheet(pattern, pitch_mm)
    margin = round(MARGIN_MM / pitch_mm)
    assert np.array_equal(sheet[margin : margin + 270, margin : margin + 480], pattern)
    below = sheet[margin + 270 + round(2 / pitch_mm) :]  # below the frame
    longest = max(len(run) for row in below for run in "".join(" #"[int(grey == 0)] for grey in row).split())
    # 121 mm wide: half of it has room for 50 mm
    assert longest * pitch_mm == pytest.approx(bar_mm(480, pitch_mm), abs=pitch_mm)
    assert bar_mm(480, pitch_mm) == 50.0
