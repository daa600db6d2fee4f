"""Pictures that surely stand, on a computer that is too busy to stamp frames in time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.commissioning.patterns import SettledPatterns, TimedPatterns, uniform_pattern
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import Frame
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig

GAMMA = 2.2
CODES = (0, 15, 30, 255, 0, 128, 255, 240, 15)


def bench() -> Rig:
    rig = load_rig("simulated")
    lcd = rig.display.model_copy(update={"columns": 240, "rows": 135, "pitch_mm": 8 * rig.display.pitch_mm})
    return binned(rig, 16).model_copy(update={"display": lcd, "scenario": "none"})


class LateFrames:
    """The simulated camera; after each change of picture some frames come, and are stamped, far too late."""

    def __init__(self, camera: Any) -> None:
        self._camera = camera
        self._last: Frame | None = None
        self.late = 0

    def read(self, timeout_s: float) -> Frame:
        frame: Frame = self._camera.read(timeout_s)
        if self.late > 0 and self._last is not None:
            self.late -= 1
            # noise of its own, so that it is no repeated frame
            return replace(frame, image=self._last.image[::-1])
        self._last = frame
        return frame

    def close(self) -> None:
        self._camera.close()


class Busy:
    """The simulated display, at each change of which the computer is busy for three frames."""

    def __init__(self, display: Any, camera: LateFrames) -> None:
        self._display, self._camera = display, camera

    def __getattr__(self, name: str) -> Any:
        return getattr(self._display, name)

    def show(self, image: NDArray[np.uint8]) -> int:
        self._camera.late = 3
        return int(self._display.show(image))


def light_of(rig: Rig, seen_to_stand: bool) -> NDArray[np.float64]:
    """(codes,) grey above black of even pictures under late stamps."""
    means = []
    with open_devices(rig) as devices:
        camera = LateFrames(devices.camera)
        devices.camera = camera  # type: ignore[assignment]
        devices.display = Busy(devices.display, camera)  # type: ignore[assignment]
        pictures = TimedPatterns(rig, devices, 0.0)
        standing = SettledPatterns(pictures)
        if seen_to_stand:
            pictures.frames(uniform_pattern(rig, 255), 8)
            standing.learn(pictures.after(pictures.show(uniform_pattern(rig, 255)), 8)[4:])
        for code in CODES:
            frames = standing.frames(uniform_pattern(rig, code), 2)
            means.append(np.mean([frame.image for frame in frames]) - rig.camera.noise.black_grey)
    return np.array(means)


def test_frames_that_are_stamped_late_are_not_taken_for_the_new_picture() -> None:
    rig = bench()
    full = rig.simulation.peak_grey_share * 255 - rig.camera.noise.black_grey
    expected = full * (np.array(CODES) / 255) ** GAMMA
    # 5120 px, two frames of noise 2.3 at most: 0.025 grey levels, 4 sigma; black is cut off at two sigma
    assert np.max(np.abs(light_of(rig, True) - expected)) < 0.1
    # and by stamps alone they are
    assert np.max(np.abs(light_of(rig, False) - expected)) > 5


def test_codes_that_look_alike_are_waited_for_no_longer_than_that() -> None:
    rig = bench()
    with open_devices(rig) as devices:
        standing = SettledPatterns(TimedPatterns(rig, devices, 0.0))
        standing.learn(standing.frames(uniform_pattern(rig, 255), 4))
        standing.frames(uniform_pattern(rig, 0), 2)
        before_ns = devices.clock.now_ns()
        taken = standing.frames(uniform_pattern(rig, 1), 2)  # 5e-6 of the light
        # hold, two frames and eight to spare at 60 per second
        assert 1e-9 * (devices.clock.now_ns() - before_ns) < 0.06 + 11 / rig.camera.rate_hz
        assert len(taken) == 2
        before_ns = devices.clock.now_ns()
        standing.frames(uniform_pattern(rig, 1), 2)
        # what stands is not waited for again
        assert 1e-9 * (devices.clock.now_ns() - before_ns) < 3.1 / rig.camera.rate_hz


def test_frames_that_follow_a_change_are_waited_for_on_a_slow_camera() -> None:
    rig = bench()
    slow = rig.model_copy(update={"camera": rig.camera.model_copy(update={"rate_hz": 12.0})})
    with open_devices(slow) as devices:
        pictures = TimedPatterns(slow, devices, 0.0)
        times = [since_s for since_s, _ in pictures.following(uniform_pattern(slow, 255), 0.1, 5)]
    assert len(times) == 5
    assert np.diff(times) == pytest.approx(1 / 12, abs=2e-3)
