"""What every driver must keep to, and what is made of it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from zeromethod import Rig, binned, load_rig, open_devices
from zeromethod.clock import SimulatedClock
from zeromethod.devices.contract import said_by, taken
from zeromethod.devices.protocols import Frame
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.watch_camera import SimulatedWatchCamera

RIG = binned(load_rig("simulated"), 8)


class OneBuffer(SimulatedCamera):
    """A camera as many libraries make them: every frame comes in the same buffer."""

    def __init__(self, rig: Rig, clock: Any, display: object) -> None:
        super().__init__(rig, clock, display)
        self._buffer = np.zeros(self.shape, np.uint8)

    def read(self, timeout_s: float) -> Frame:
        frame = super().read(timeout_s)
        self._buffer[...] = frame.image
        return replace(frame, image=self._buffer)


def keeps_its_frames(read: Callable[[], Frame]) -> bool:
    """Whether images stay what they were while others are read."""
    frames, copies = [], []
    for _ in range(4):
        frames.append(read())
        copies.append(frames[-1].image.copy())
    return all(np.array_equal(one.image, copy) for one, copy in zip(frames, copies, strict=True))


def test_a_driver_that_gives_its_buffers_away_keeps_to_it():
    with open_devices(RIG) as devices:
        watch = SimulatedWatchCamera(load_rig("contactless"), clock := SimulatedClock())

        def watched() -> Frame:
            clock.sleep_until_ns(clock.now_ns() + 10**8)
            return watch.read(0.0)

        found: tuple[tuple[Any, Callable[[], Frame]], ...] = (
            (devices.camera, lambda: devices.camera.read(1.0)),
            (watch, watched),
        )
        for camera, read in found:
            assert camera.read.gives_buffers
            assert keeps_its_frames(read)


def test_a_buffer_that_is_filled_again_is_copied_whatever_its_driver_is_derived_from():
    rig = RIG.replace({"camera.driver": f"{__name__}:OneBuffer"})
    with open_devices(rig) as devices:
        assert not keeps_its_frames(lambda: devices.camera.read(1.0))
        assert keeps_its_frames(lambda: taken(devices.camera.read, 1.0))


def test_an_exception_that_cannot_say_what_it_is_says_nothing():
    class Mute(Exception):
        def __str__(self):
            raise RuntimeError

    assert said_by(Mute()) == ""
    assert said_by(ValueError("two\nlines")) == "two lines"
