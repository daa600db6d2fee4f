"""The threads round the loop, each alone: newest only, no waiting for devices. See also test_worker.py."""

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, Camera, eventually, takes

from zeromethod.devices.protocols import CameraTimeout, DisplayLost, Frame
from zeromethod.errors import InputError
from zeromethod.loop import drawing
from zeromethod.loop.drawing import Drawing, Drawn
from zeromethod.loop.frame_source import GRACE_S, Capture
from zeromethod.pattern.strips import CODES

# Capture

Captured = Callable[..., Capture]


@pytest.fixture
def captured() -> Iterator[Captured]:
    made = []

    def make(camera: Camera, meanwhile: Callable[[], object] = lambda: None) -> Capture:
        made.append(Capture(camera, meanwhile))  # type: ignore[arg-type]
        return made[-1]

    yield make
    for capture in made:
        capture.close()


def given(number: int) -> Frame:
    return Frame(np.zeros((4, 4), np.uint8), 0, 1, number)


def test_a_captured_camera_is_read_only_when_a_frame_is_wanted(captured):
    camera = Camera(given(1), given(2))
    capture = captured(camera)
    time.sleep(0.02)
    assert camera.reads == []
    assert capture.read(PATIENCE_S).number == 1
    time.sleep(0.02)
    # nothing is read ahead, so nothing can queue
    assert camera.reads == [PATIENCE_S]
    assert capture.read(PATIENCE_S).number == 2


def test_a_camera_that_hangs_times_out_and_its_late_frame_is_not_lost(captured, hung):
    def late() -> Frame:
        hung.wait(PATIENCE_S)
        return given(1)

    calls: list[int] = []
    camera = Camera(late, given(2))
    capture = captured(camera, lambda: calls.append(1))
    for _ in range(2):
        with takes(0.1 + GRACE_S, SOON_S), pytest.raises(CameraTimeout):
            capture.read(0.1)
    # the thread that waits looks round meanwhile, and asks but once
    assert len(calls) >= 2
    assert len(camera.reads) == 1
    hung.set()
    assert [capture.read(PATIENCE_S).number for _ in range(2)] == [1, 2]


def test_a_late_answer_that_there_was_no_frame_is_not_counted_twice(captured, hung):
    def slow() -> CameraTimeout:
        hung.wait(PATIENCE_S)
        return CameraTimeout()

    capture = captured(Camera(slow, given(1)))
    with pytest.raises(CameraTimeout):
        capture.read(0.1)
    hung.set()
    assert capture.read(PATIENCE_S).number == 1


# Drawing


class Pen:
    """A drawer that notes what it is given, and waits for `go`."""

    gl_renderer = "pen"

    def __init__(self) -> None:
        self.shown: list[tuple[float, int | None]] = []
        self.go = threading.Event()
        self.go.set()
        self.closed = False

    def draw(self, q: np.ndarray, code: int | None = None, *_: object) -> int:
        self.shown.append((float(q[0]), code))
        self.go.wait(PATIENCE_S)
        return len(self.shown)

    def close(self) -> None:
        self.closed = True


def drawing_with(pen: Pen, timeout_s: float = PATIENCE_S, coded: bool = True, live: bool = True) -> Drawing:
    return Drawing(lambda: pen, coded, timeout_s, live)  # type: ignore[arg-type,return-value]


def collected(what: Drawing, count: int) -> list[Drawn]:
    found: list[Drawn] = []
    eventually(lambda: len(found.extend(what.collect()) or found) >= count)  # type: ignore[func-returns-value]
    return found


@pytest.mark.parametrize("live", [True, False])
@pytest.mark.parametrize("coded", [True, False])
def test_codes_run_round_and_are_left_out_where_there_are_no_strips(live, coded):
    what = drawing_with(Pen(), coded=coded, live=live)
    codes = []
    for k in range(CODES + 2):
        what.post(np.array([float(k)]), None)
        codes += [one.code for one in collected(what, 1)]
    assert codes == ([*range(CODES), 0, 1] if coded else [None] * (CODES + 2))
    what.close()


def test_a_display_that_hangs_is_lost_after_its_timeout_but_not_while_it_prepares(monkeypatch):
    pen = Pen()
    what = drawing_with(pen, timeout_s=0.05)
    pen.go.clear()
    what.post(np.array([1.0]), None)
    eventually(lambda: pen.shown)
    time.sleep(0.15)
    assert what.collect() == []  # the first picture: shaders may be compiled
    monkeypatch.setattr(drawing, "OPENING_S", 0.05)
    with pytest.raises(DisplayLost, match=r"showing one picture for \d"):
        what.collect()
    monkeypatch.undo()
    pen.go.set()
    collected(what, 1)
    pen.go.clear()
    what.post(np.array([2.0]), None)
    eventually(lambda: len(pen.shown) == 2)
    time.sleep(0.15)
    with pytest.raises(DisplayLost):
        what.collect()
    with takes(0, SOON_S):
        what.close()
    pen.go.set()
    eventually(lambda: pen.closed)


def test_a_drawer_that_cannot_be_made_in_time_is_refused(monkeypatch, hung):
    monkeypatch.setattr(drawing, "OPENING_S", 0.1)
    with pytest.raises(InputError, match=r"display: not ready to be drawn on within 0\.1 s"):
        Drawing(lambda: hung.wait(PATIENCE_S), coded=False, timeout_s=1, live=True)  # type: ignore[arg-type,return-value]
