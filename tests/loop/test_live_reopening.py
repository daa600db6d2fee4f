"""Devices lost, opened again and closed, any of which may hang."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from hanging import PATIENCE_S, Camera, eventually

from zeromethod.clock import HostClock
from zeromethod.devices.opening import CLOSING_S, Devices
from zeromethod.devices.protocols import CameraLost
from zeromethod.errors import MeasurementError
from zeromethod.loop.frame_source import FrameSource
from zeromethod.loop.live import reopening
from zeromethod.loop.live.reopening import Reopener


def raising(error: BaseException) -> Callable[..., Any]:
    def call(*_: object) -> None:
        raise error

    return call


# Reopening


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reopening, "WAITS_S", (0.04, 0.06, 0.08))
    monkeypatch.setattr(reopening, "SLICE_S", 0.01)


def attempts(what: Reopener) -> Any:
    end_s = time.monotonic() + PATIENCE_S
    while (camera := what.attempt()) is None and not what.exhausted:
        assert time.monotonic() < end_s
    return camera


@pytest.mark.usefixtures("quick")
def test_reopening_says_what_it_does_and_gives_up_after_three() -> None:
    def never() -> Any:
        raise CameraLost("still gone")

    what = Reopener(never, HostClock(), live=True)
    assert what.plan == ""
    plans = set()
    while not what.exhausted:
        what.attempt()
        plans.add(what.plan.split(" (")[-1])
    assert plans >= {"attempt 1 of 3)", "attempt 2 of 3)", "attempt 3 of 3)"}
    assert what.plan == ""
    assert what.failure == "still gone"
    assert what.attempt() is None


@pytest.mark.usefixtures("quick")
def test_an_opening_that_hangs_counts_as_failed_and_its_camera_is_closed_when_it_comes(
    monkeypatch: pytest.MonkeyPatch, hung: threading.Event
) -> None:
    monkeypatch.setattr(reopening, "OPENING_S", 0.1)
    late, good = Camera(), Camera()
    calls: list[int] = []

    def reopen() -> Any:
        calls.append(1)
        if len(calls) == 1:
            hung.wait(PATIENCE_S)
            return late
        return good

    what = Reopener(reopen, HostClock(), live=True)
    started = time.monotonic()
    what.attempt()
    assert time.monotonic() - started < 0.5
    assert attempts(what) is good
    assert not late.closed
    hung.set()
    eventually(lambda: late.closed == 1)
    assert not good.closed


@pytest.mark.usefixtures("quick")
def test_a_camera_that_is_being_opened_when_the_run_ends_is_closed(hung: threading.Event) -> None:
    camera = Camera()

    def reopen() -> Any:
        hung.wait(PATIENCE_S)
        return camera

    source = FrameSource(Camera(CameraLost("gone")), reopen, HostClock(), 0.2, lambda: None)  # type: ignore[arg-type]
    source.next()
    while "it is being opened again" not in (trouble := source.next()).reason:  # type: ignore[union-attr]
        assert not trouble.ends  # type: ignore[union-attr]
    source.close()
    hung.set()
    eventually(lambda: camera.closed == 1)
    assert "could not be opened" in source.next().reason  # type: ignore[union-attr]


@pytest.mark.usefixtures("quick")
def test_what_a_driver_may_not_raise_passes_through_reopening() -> None:
    def broken() -> Any:
        raise AttributeError("typo")

    what = Reopener(broken, HostClock(), live=True)
    with pytest.raises(AttributeError, match="typo"):
        attempts(what)


# Devices


def devices(open_camera: Callable[[], Any], display: Any = None) -> Devices:
    return Devices(Camera(), display or Camera(), HostClock(), open_camera)  # type: ignore[arg-type]


def test_reopening_does_without_the_lost_cameras_close(hung: threading.Event) -> None:
    fresh = Camera()
    for close in (lambda: hung.wait(PATIENCE_S), raising(RuntimeError("no device"))):
        what = devices(lambda: fresh)
        what.camera.close = close  # type: ignore[method-assign]
        started = time.monotonic()
        assert what.reopen_camera() is fresh  # type: ignore[comparison-overlap]
        assert time.monotonic() - started < CLOSING_S + 1
        assert what.camera is fresh  # type: ignore[comparison-overlap]


def test_a_camera_that_opens_late_does_not_take_the_place_of_a_newer_one(hung: threading.Event) -> None:
    late, newer = Camera(), Camera()
    calls: list[int] = []

    def open_camera() -> Any:
        calls.append(1)
        if len(calls) == 1:
            hung.wait(PATIENCE_S)
            return late
        return newer

    what = devices(open_camera)
    got: list[Any] = []
    thread = threading.Thread(target=lambda: got.append(what.reopen_camera()))
    thread.start()
    eventually(lambda: len(calls) == 1)
    assert what.reopen_camera() is newer  # type: ignore[comparison-overlap]
    hung.set()
    thread.join()
    assert got == [late]
    what.close()
    assert newer.closed == 1


@pytest.mark.parametrize("which", ["camera", "display", "both"])
def test_devices_that_hang_when_closed_are_left_within_their_time(which: str, hung: threading.Event) -> None:
    what = devices(Camera)
    for name in ("camera", "display"):
        if which in {name, "both"}:
            getattr(what, name).close = lambda: hung.wait(PATIENCE_S)
    started = time.monotonic()
    with pytest.raises(MeasurementError, match="cannot be closed: not within"):
        what.close(CLOSING_S)
    assert time.monotonic() - started < CLOSING_S + 0.4


def test_windows_are_closed_in_the_callers_thread() -> None:
    where: list[threading.Thread] = []
    for name in ("poll", "other"):
        display = Camera()
        setattr(display, name, lambda: None)
        display.close = lambda: where.append(threading.current_thread())  # type: ignore[method-assign]
        devices(Camera, display).close()
    assert where[0] is threading.current_thread()
    assert where[1] is not threading.current_thread()
