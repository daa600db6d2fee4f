import threading
import time

import numpy as np
import pytest

from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame
from zeromethod.drivers.newest import Newest


def frame(number: int, dropped: int = 0) -> Frame:
    return Frame(np.zeros((2, 2), np.uint8), 1000 * number, 10, number, dropped)


def test_only_the_newest_is_kept_and_what_it_replaced_is_counted() -> None:
    newest = Newest()
    for number in range(5):
        newest.put(frame(number))
    taken = newest.take(0)
    assert (taken.number, taken.dropped) == (4, 4)


def test_frames_lost_before_they_arrived_count_too_and_once() -> None:
    newest = Newest()
    newest.put(frame(3, dropped=2))
    newest.put(frame(7, dropped=3))
    assert newest.take(0).dropped == 6
    newest.put(frame(8))
    assert newest.take(0).dropped == 0


def test_a_frame_is_taken_once() -> None:
    newest = Newest()
    newest.put(frame(0))
    newest.take(0)
    with pytest.raises(CameraTimeout, match=r"^no frame within 0\.02 s$"):
        newest.take(0.02)


def test_taking_waits_for_a_frame_and_no_longer() -> None:
    newest = Newest()
    threading.Timer(0.1, newest.put, (frame(1),)).start()
    start = time.monotonic()
    assert newest.take(5).number == 1
    assert time.monotonic() - start < 2  # 0.1 s and what a busy machine adds


def test_the_end_is_told_after_the_last_frame_and_wakes_who_waits() -> None:
    newest = Newest()
    newest.put(frame(1))
    newest.end("pulled out")
    newest.end("a later reason")
    assert newest.take(0).number == 1
    with pytest.raises(CameraLost, match=r"^pulled out$"):
        newest.take(0)
    other = Newest()
    threading.Timer(0.1, other.end, ("gone",)).start()
    with pytest.raises(CameraLost, match="gone"):
        other.take(5)
