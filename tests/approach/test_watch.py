import threading

import numpy as np
import pytest
from watched import RIG

from zeromethod.approach import Watch, Watching, WatchReader
from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.devices.protocols import CameraTimeout, Frame
from zeromethod.devices.watch_camera import watch_opener
from zeromethod.errors import InputError


def looked(kind, until_s):
    """States seen in three seconds with a fault from 0.5 s on, each with the notes it brought."""
    rig = RIG.replace(
        {"scenario": "none", "simulation.faults.watch": kind, "simulation.faults.watch_s": [0.5, until_s]}
    )
    clock = SimulatedClock()
    watch = Watch(rig, clock, watch_opener(rig, clock))
    found, notes = [], []
    for frame in range(180):
        clock.sleep_until_ns(round(1e9 * frame / 60))
        found.append(watch.look().watching)
        notes += watch.note()
    watch.close()
    return found, notes


def test_each_fault_of_the_watch_camera_is_named_and_over_when_it_is():
    expected = {
        "stall": Watching.STALLED,
        "lost": Watching.LOST,
        "repeat": Watching.BLIND,
        "dark": Watching.BLIND,
    }
    for kind, state in expected.items():
        found, notes = looked(kind, 1.5)
        assert state in found[30:100], kind
        assert found[-1] is Watching.CLEAR, kind
        assert len(notes) == 2, notes
        assert "what comes is not seen" in notes[0]
        assert notes[1] == "watch camera: back"


def test_a_camera_that_hangs_or_lies_keeps_nobody_waiting():
    ended = threading.Event()

    class Hanging:
        shape, bits = (240, 320), 8

        def read(self, timeout_s):
            ended.wait(30.0)
            raise CameraTimeout

        def close(self):
            ended.set()

    class Lying(Hanging):
        def read(self, timeout_s):
            raise ZeroDivisionError("no frame")

    class Leaving(Hanging):
        def read(self, timeout_s):
            raise SystemExit(3)

    class Counting(Hanging):
        def read(self, timeout_s):
            return Frame(np.zeros(self.shape, np.uint8), 2**70, 10**6, 0)

    clock = HostClock()
    kinds = ((Hanging, Watching.STALLED), *((one, Watching.LOST) for one in (Lying, Leaving, Counting)))
    for camera, state in kinds:
        watch = Watch(RIG, clock, camera)
        start_ns = clock.now_ns()
        while watch.look().watching is not state:
            assert clock.now_ns() - start_ns < 5e9
            clock.sleep_until_ns(clock.now_ns() + 20_000_000)
        ended.set()
        watch.close()


def test_a_frame_that_cannot_be_read_does_not_end_the_run(monkeypatch):
    def failing(reader, image, time_ns):
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr(WatchReader, "take", failing)
    found, notes = looked("none", 0.0)
    assert found[-1] is Watching.BLIND
    assert "ZeroDivisionError" in notes[0]


class OneLens:
    """A camera with one lens: half the columns of a frame with two views."""

    shape, bits = (240, 160), 8

    def read(self, timeout_s):
        raise CameraTimeout

    def close(self):
        pass


def test_a_camera_with_one_lens_is_refused_by_what_it_cannot_know():
    driver = f"{__name__}:OneLens"
    rig = RIG.replace({"watch.driver": driver, "camera.driver": driver})
    with pytest.raises(InputError, match=r"two lenses side by side.*cannot be known when something touches"):
        watch_opener(rig, HostClock())()
