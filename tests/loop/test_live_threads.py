"""The threads round the loop, each alone: newest only, no waiting for devices, nothing left changed."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S, Camera, alive, eventually

from zeromethod.clock import HostClock
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost
from zeromethod.errors import InputError
from zeromethod.loop import drawing
from zeromethod.loop.drawing import Drawing, Drawn
from zeromethod.loop.frame_source import GRACE_S, Capture, FrameSource
from zeromethod.pattern.strips import CODES

# Capture


def test_a_captured_camera_is_read_only_when_a_frame_is_wanted() -> None:
    camera = Camera("a", "b")
    capture = Capture(camera, lambda: None)
    time.sleep(0.02)
    assert camera.reads == []
    assert capture.read(0.5) == "a"
    time.sleep(0.02)
    # nothing is read ahead, so nothing can queue
    assert camera.reads == [0.5]
    assert capture.read(0.7) == "b"
    capture.close()


def test_what_a_camera_raises_is_raised_where_it_was_asked() -> None:
    capture = Capture(Camera(CameraLost("gone"), ValueError("odd"), "a"), lambda: None)
    with pytest.raises(CameraLost, match="gone"):
        capture.read(1)
    with pytest.raises(ValueError, match="odd"):
        capture.read(1)
    assert capture.read(1) == "a"
    capture.close()


def test_a_camera_that_hangs_times_out_and_its_late_frame_is_not_lost(hung: threading.Event) -> None:
    def late() -> str:
        hung.wait(PATIENCE_S)
        return "late"

    turns: list[int] = []
    camera = Camera(late, "next")
    capture = Capture(camera, lambda: turns.append(1))
    for _ in range(2):
        started = time.monotonic()
        with pytest.raises(CameraTimeout):
            capture.read(0.1)
        assert 0.1 + GRACE_S <= time.monotonic() - started < 1
    # the thread that waits looks round meanwhile, and asks but once
    assert len(turns) >= 4
    assert len(camera.reads) == 1
    hung.set()
    assert capture.read(1) == "late"
    assert capture.read(1) == "next"
    capture.close()


def test_a_late_answer_that_there_was_no_frame_is_not_counted_twice() -> None:
    def slow() -> CameraTimeout:
        time.sleep(0.1 + GRACE_S + 0.1)
        return CameraTimeout()

    capture = Capture(Camera(slow, "good"), lambda: None)
    with pytest.raises(CameraTimeout):
        capture.read(0.1)
    assert capture.read(1) == "good"
    capture.close()


def test_what_is_raised_meanwhile_ends_the_waiting(hung: threading.Event) -> None:
    def meanwhile() -> None:
        raise DisplayLost("unplugged")

    capture = Capture(Camera(lambda: hung.wait(PATIENCE_S)), meanwhile)
    with pytest.raises(DisplayLost):
        capture.read(5)
    capture.close()


def test_capture_threads_end_with_their_camera(hung: threading.Event) -> None:
    before = alive("capture")
    idle = Capture(Camera("a"), lambda: None)
    busy = Capture(Camera(lambda: hung.wait(PATIENCE_S)), lambda: None)
    with pytest.raises(CameraTimeout):
        busy.read(0.01)
    idle.close()
    busy.close()
    eventually(lambda: len(alive("capture") - before) == 1)
    hung.set()
    eventually(lambda: alive("capture") <= before)


def test_frames_that_are_none_are_refused_by_name() -> None:
    source = FrameSource(Camera(object()), None, HostClock(), 0.2, lambda: None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"read\(\) gave object, which lacks image"):
        source.next()
    source.close()


# Drawing


class Pen:
    """A drawer that notes what it is given; `hold` keeps it until it is set."""

    gl_renderer = "pen"

    def __init__(self) -> None:
        self.shown: list[tuple[float, int | None]] = []
        self.go = threading.Event()
        self.go.set()
        self.error: BaseException | None = None
        self.closed = False

    def draw(self, q: np.ndarray, code: int | None = None) -> int:
        self.shown.append((float(q[0]), code))
        self.go.wait(PATIENCE_S)
        if self.error is not None:
            raise self.error
        return len(self.shown)

    def close(self) -> None:
        self.closed = True


def collected(what: Drawing, count: int) -> list[Drawn]:
    found: list[Drawn] = []
    end_s = time.monotonic() + PATIENCE_S
    while len(found) < count:
        found += what.collect()
        assert time.monotonic() < end_s
        time.sleep(0.001)
    return found


def test_only_the_newest_picture_is_shown_when_the_display_is_slow() -> None:
    pen = Pen()
    pen.go.clear()
    what = Drawing(lambda: pen, coded=True, timeout_s=5, live=True)  # type: ignore[arg-type,return-value]
    what.post(np.array([0.0]), 100)
    eventually(lambda: len(pen.shown) == 1)
    for k in range(1, 30):
        what.post(np.array([float(k)]), 100 + k)
    pen.go.set()
    done = collected(what, 2)
    assert [float(one.q[0]) for one in done] == [0.0, 29.0]
    assert [one.source_ns for one in done] == [100, 129]
    # codes count what was shown, not what was asked for
    assert [one.code for one in done] == [0, 1]
    assert what.collect() == []
    what.close()
    assert pen.closed


@pytest.mark.parametrize("live", [True, False])
def test_codes_run_round_and_are_left_out_where_there_are_no_strips(live: bool) -> None:
    for coded in (True, False):
        pen = Pen()
        what = Drawing(lambda pen=pen: pen, coded, 5.0, live)  # type: ignore[misc,arg-type]
        codes = []
        for k in range(CODES + 2):
            what.post(np.array([float(k)]), None)
            codes += [one.code for one in collected(what, 1)]
        assert codes == ([*range(CODES), 0, 1] if coded else [None] * (CODES + 2))
        what.close()


def test_what_the_display_raises_comes_after_what_it_showed() -> None:
    pen = Pen()
    what = Drawing(lambda: pen, coded=False, timeout_s=5, live=True)  # type: ignore[arg-type,return-value]
    what.post(np.array([1.0]), None)
    eventually(lambda: len(pen.shown) == 1)
    time.sleep(0.02)
    pen.error = DisplayLost("window closed")
    what.post(np.array([2.0]), None)
    eventually(lambda: pen.closed)
    assert len(what.collect()) == 1
    with pytest.raises(DisplayLost, match="window closed"):
        what.collect()
    what.close()


def test_a_display_that_hangs_is_lost_after_its_timeout_but_not_while_it_prepares(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pen = Pen()
    what = Drawing(lambda: pen, coded=False, timeout_s=0.05, live=True)  # type: ignore[arg-type,return-value]
    pen.go.clear()
    what.post(np.array([1.0]), None)
    time.sleep(0.15)
    assert what.collect() == []  # the first picture: shaders may be compiled
    monkeypatch.setattr(drawing, "OPENING_S", 0.05)
    with pytest.raises(DisplayLost, match=r"showing one picture for 0\."):
        what.collect()
    monkeypatch.undo()
    pen.go.set()
    collected(what, 1)
    pen.go.clear()
    what.post(np.array([2.0]), None)
    time.sleep(0.15)
    with pytest.raises(DisplayLost):
        what.collect()
    started = time.monotonic()
    what.close()
    assert time.monotonic() - started < 0.6
    pen.go.set()
    eventually(lambda: pen.closed)


def test_what_draws_and_cannot_be_made_is_told_where_it_was_asked_for(
    monkeypatch: pytest.MonkeyPatch, hung: threading.Event
) -> None:
    before = alive("drawing")

    def broken() -> Any:
        raise InputError("no GL")

    with pytest.raises(InputError, match="no GL"):
        Drawing(broken, coded=False, timeout_s=1, live=True)
    monkeypatch.setattr(drawing, "OPENING_S", 0.1)

    def hangs() -> Any:
        hung.wait(PATIENCE_S)
        return Pen()

    with pytest.raises(InputError, match=r"display: not ready to be drawn on within 0\.1 s"):
        Drawing(hangs, coded=False, timeout_s=1, live=True)
    hung.set()
    eventually(lambda: alive("drawing") <= before)
