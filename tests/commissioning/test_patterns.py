"""Pictures that have surely settled, on a computer that is too busy to stamp frames in time."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod import Rig, open_devices
from zeromethod.commissioning.patterns import SettledPatterns, TimedPatterns, uniform_pattern
from zeromethod.devices.protocols import Frame
from zeromethod.errors import MeasurementError

from .setting_up_benches import SMALL_RIG, Altered

GAMMA = 2.2
CODES = (0, 15, 30, 255, 0, 128, 255, 240, 15)


def light_of(rig: Rig, known_noise: bool) -> NDArray[np.float64]:
    """(codes,) grey above black of uniform pictures, each followed by three late frames."""
    means, late, last = [], count(3), list[Frame]()
    with open_devices(rig) as devices:
        camera, display = devices.camera, devices.display

        def show(image: NDArray[np.uint8]) -> int:
            nonlocal late
            late = count()
            return int(display.show(image))

        def read(timeout_s: float) -> Frame:
            frame = camera.read(timeout_s)
            if next(late) < 3 and last:
                # noise of its own, so that it is no repeated frame
                return replace(frame, image=last[-1].image[::-1])
            last.append(frame)
            return frame

        devices.camera, devices.display = Altered(camera, read=read), Altered(display, show=show)
        pictures = TimedPatterns(rig, devices, 0.0)
        settled = SettledPatterns(pictures)
        if known_noise:
            pictures.frames(uniform_pattern(rig, 255), 8)
            settled.learn(pictures.after(pictures.show(uniform_pattern(rig, 255)), 8)[4:])
        for code in CODES:
            frames = settled.frames(uniform_pattern(rig, code), 2)
            means.append(np.mean([frame.image for frame in frames]) - rig.camera.noise.black_grey)
    return np.array(means)


def test_frames_that_are_stamped_late_are_not_taken_for_the_new_picture():
    rig = SMALL_RIG
    full = rig.simulation.peak_grey_share * 255 - rig.camera.noise.black_grey
    expected = full * (np.array(CODES) / 255) ** GAMMA
    # 5120 px, two frames of noise 2.3 at most: 0.025 grey levels, 4 sigma; black is cut off at two sigma
    assert np.max(np.abs(light_of(rig, True) - expected)) < 0.1
    # and by stamps alone they are
    assert np.max(np.abs(light_of(rig, False) - expected)) > 5


def test_codes_that_look_alike_are_waited_for_no_longer_than_that():
    rig = SMALL_RIG
    with open_devices(rig) as devices:
        settled = SettledPatterns(TimedPatterns(rig, devices, 0.0))
        settled.learn(settled.frames(uniform_pattern(rig, 255), 4))
        settled.frames(uniform_pattern(rig, 0), 2)
        before_ns = devices.clock.now_ns()
        taken = settled.frames(uniform_pattern(rig, 1), 2)  # 5e-6 of the light
        # hold, two frames and eight to spare at 60 per second
        assert 1e-9 * (devices.clock.now_ns() - before_ns) < 0.06 + 11 / rig.camera.rate_hz
        assert len(taken) == 2
        before_ns = devices.clock.now_ns()
        settled.frames(uniform_pattern(rig, 1), 2)
        # what is shown already is not waited for again
        assert 1e-9 * (devices.clock.now_ns() - before_ns) < 3.1 / rig.camera.rate_hz


def test_frames_that_follow_a_change_are_waited_for_on_a_slow_camera():
    rig = SMALL_RIG
    slow = rig.model_copy(update={"camera": rig.camera.model_copy(update={"rate_hz": 12.0})})
    with open_devices(slow) as devices:
        pictures = TimedPatterns(slow, devices, 0.0)
        times = [since_s for since_s, _ in pictures.following(uniform_pattern(slow, 255), 0.1, 5)]
    assert len(times) == 5
    assert np.diff(times) == pytest.approx(1 / 12, abs=2e-3)


def test_a_driver_that_breaks_its_contract_is_named():
    with open_devices(SMALL_RIG) as devices:
        camera, display = devices.camera, devices.display

        def short(timeout_s: float) -> Frame:
            frame = camera.read(timeout_s)
            return replace(frame, image=frame.image[:-2])

        devices.display = Altered(display, show=lambda _: None)
        dark = uniform_pattern(SMALL_RIG, 0)
        with pytest.raises(MeasurementError, match=r"show\(\) gave None, not the presentation time in ns"):
            TimedPatterns(SMALL_RIG, devices, 0.0).show(dark)
        devices.camera, devices.display = Altered(camera, read=short), display
        with pytest.raises(MeasurementError, match=r"the frame is \(\d+, \d+\) uint8, not \("):
            TimedPatterns(SMALL_RIG, devices, 0.0).frames(dark, 1)
