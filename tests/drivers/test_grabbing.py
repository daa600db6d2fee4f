"""The grabbing thread, with sources that hang, fail and wait to be asked."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, eventually, raising, takes

from zeromethod.devices.protocols import Camera, CameraLost, CameraTimeout, Frame
from zeromethod.drivers.grabbing import GrabbedCamera


class Scripted:
    """A source whose grab is what the test says. It notes where it was used."""

    shape, bits = (2, 3), 8

    def __init__(self, grab: Callable[[int], Frame | None], on_demand: bool = False) -> None:
        self.on_demand = on_demand
        self.calls = 0
        self.threads = {threading.current_thread()}
        self.closed = threading.Event()
        self._grab = grab

    def grab(self) -> Frame | None:
        self.threads.add(threading.current_thread())
        self.calls += 1
        return self._grab(self.calls)

    def close(self) -> None:
        self.threads.add(threading.current_thread())
        self.closed.set()


def frame(number: int) -> Frame:
    return Frame(np.zeros((2, 3), np.uint8), 1000 * number, 10, number)


def every_10_ms(number: int) -> Frame:
    time.sleep(0.01)
    return frame(number)


def opened(source: Callable[[], Scripted], timeout_s: float = PATIENCE_S) -> GrabbedCamera:
    return GrabbedCamera("test", source, timeout_s)


def test_it_is_a_camera_whose_device_is_used_by_one_thread_only():
    sources: list[Scripted] = []
    camera = opened(lambda: sources.append(Scripted(every_10_ms)) or sources[-1])  # type: ignore[func-returns-value]
    assert isinstance(camera, Camera)
    assert (camera.shape, camera.bits) == ((2, 3), 8)
    first = camera.read(PATIENCE_S)
    time.sleep(0.1)
    later = camera.read(PATIENCE_S)
    assert later.number - first.number == 1 + later.dropped > 2
    for _ in range(2):
        camera.close()
    assert sources[0].closed.is_set()
    assert len(sources[0].threads) == 1
    assert threading.current_thread() not in sources[0].threads
    with pytest.raises(CameraLost, match=r"^it is closed$"):
        camera.read(0.1)


def test_a_hung_device_times_out_and_is_closed_once_it_answers():
    answer = threading.Event()
    source = Scripted(lambda _: answer.wait() and None)
    camera = opened(lambda: source)
    with pytest.raises(CameraTimeout):
        camera.read(0.05)
    with takes(0, SOON_S):  # hung or not
        camera.close()
    assert not source.closed.is_set()
    answer.set()
    assert source.closed.wait(PATIENCE_S)


def test_a_device_that_hangs_while_it_is_opened_is_given_up_and_closed_later():
    answer, source = threading.Event(), Scripted(every_10_ms)

    def slow() -> Scripted:
        answer.wait()
        return source

    with pytest.raises(CameraLost, match=r"^test: did not open within 0\.05 s$"):
        opened(slow, 0.05)
    answer.set()
    assert source.closed.wait(PATIENCE_S)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (CameraLost("unplugged"), "^unplugged$"),
        (OSError("bus\nreset"), "^OSError: bus reset$"),
        (SystemExit(3), "^SystemExit: 3$"),
    ],
)
def test_whatever_the_device_raises_later_is_a_lost_camera(error, message):
    camera = opened(lambda: Scripted(raising(error)))
    with pytest.raises(CameraLost, match=message):
        camera.read(PATIENCE_S)
    camera.close()


def test_on_demand_each_read_takes_one_exposure():
    source = Scripted(frame, on_demand=True)
    camera = opened(lambda: source)
    time.sleep(0.2)
    assert source.calls == 0
    assert [camera.read(PATIENCE_S).number for _ in range(3)] == [1, 2, 3]
    time.sleep(0.2)
    assert source.calls == 3
    camera.close()


def test_frames_lost_before_they_arrived_count_as_dropped_and_once():
    go = threading.Event()

    def script(call: int) -> Frame | None:
        if call == 3:
            go.wait(PATIENCE_S)
        if call > 3:
            time.sleep(0.01)
            return None
        return replace(frame((3, 7, 8)[call - 1]), dropped=(2, 3, 0)[call - 1])

    source = Scripted(script)
    camera = opened(lambda: source)
    eventually(lambda: source.calls == 3)
    newest = camera.read(PATIENCE_S)
    assert (newest.number, newest.dropped) == (7, 6)
    go.set()
    newest = camera.read(PATIENCE_S)
    assert (newest.number, newest.dropped) == (8, 0)
    with pytest.raises(CameraTimeout, match=r"^no frame within 0\.02 s$"):
        camera.read(0.02)
    camera.close()


def test_the_last_frame_is_read_before_the_loss_which_stays():
    def script(call: int) -> Frame:
        if call == 2:
            raise CameraLost("pulled out")
        return frame(call)

    source = Scripted(script)
    camera = opened(lambda: source)
    assert source.closed.wait(PATIENCE_S)
    assert camera.read(PATIENCE_S).number == 1
    for _ in range(2):
        with pytest.raises(CameraLost, match=r"^pulled out$"):
            camera.read(PATIENCE_S)
    camera.close()


def test_a_buffer_that_the_device_fills_again_and_again_spoils_no_frame_in_hand():
    buffer, go, filled = np.zeros((2, 3), np.uint8), threading.Event(), threading.Event()

    def script(call: int) -> Frame:
        if call > 1:
            go.wait(PATIENCE_S)
        buffer[...] = call
        if call > 1:
            filled.set()
        return replace(frame(call), image=buffer)

    camera = opened(lambda: Scripted(script))
    first = camera.read(PATIENCE_S)
    go.set()
    assert filled.wait(PATIENCE_S)
    assert (first.image == 1).all()
    camera.close()


def test_closing_wakes_who_reads():
    camera = opened(lambda: Scripted(lambda _: time.sleep(0.01)))
    threading.Timer(0.1, camera.close).start()
    with pytest.raises(CameraLost, match=r"^it is closed$"):
        camera.read(PATIENCE_S)
