"""Devices lost, opened again and closed, any of which may hang."""

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, Camera, eventually, raising, takes

from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.devices.opening import CLOSING_S, Devices
from zeromethod.devices.protocols import CameraLost
from zeromethod.errors import MeasurementError
from zeromethod.loop import reopening
from zeromethod.loop.frame_source import FrameSource
from zeromethod.loop.reopening import Reopener
from zeromethod.worker import in_thread

# Reopening in simulated time


class Port:
    """Fails `fails` times, then gives a camera."""

    def __init__(self, fails: int) -> None:
        self.fails = fails
        self.calls = 0

    def __call__(self) -> Any:
        self.calls += 1
        if self.calls <= self.fails:
            raise CameraLost("still gone")
        return self


@pytest.mark.parametrize("for_s", [0.2, 10.0, 60.0])
def test_a_camera_is_tried_for_the_time_that_is_set_and_when_that_is_up(for_s):
    port, clock = Port(fails=99), SimulatedClock()
    what = Reopener(port, clock, live=False, for_s=for_s)
    tried_s = []
    while not what.exhausted:
        assert what.attempt() is None
        tried_s.append(1e-9 * clock.now_ns())
    # 0.5, 2, then 8 s apart
    usual_s = [0.5, 2.5, *np.arange(10.5, 60.0, 8.0)]
    assert tried_s == pytest.approx([*(time_s for time_s in usual_s if time_s < for_s), for_s])
    assert what.attempt() is None


def test_a_camera_that_reboots_comes_back():
    """Half a minute is three attempts of 8 s more than the first."""
    clock = SimulatedClock()

    def boots() -> Any:
        if clock.now_ns() < 30e9:
            raise CameraLost("still gone")
        return "camera"

    what = Reopener(boots, clock, live=False, for_s=60.0)
    while (camera := what.attempt()) is None:
        assert not what.exhausted
    assert camera == "camera"
    assert 30e9 <= clock.now_ns() <= 38e9


def test_a_loose_plug_is_followed_three_times_a_minute():
    port, clock = Port(fails=0), SimulatedClock()
    what = Reopener(port, clock, live=False, for_s=60.0)
    assert [what.attempt() for _ in range(3)] == [port] * 3
    assert what.exhausted
    clock.sleep_until_ns(clock.now_ns() + 61 * 10**9)
    assert not what.exhausted


# Reopening in the host's time


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reopening, "WAITS_S", (0.04, 0.06, 0.08))
    monkeypatch.setattr(reopening, "SLICE_S", 0.01)


def attempts(what: Reopener) -> Any:
    end_s = time.monotonic() + PATIENCE_S
    while (camera := what.attempt()) is None and not what.exhausted:
        assert time.monotonic() < end_s
    return camera


def hangs_first(hung: threading.Event, late: Camera, then: Camera) -> tuple[Callable[[], Any], list[int]]:
    """Opens `late` when `hung` is set, and `then` at once; the calls."""
    calls: list[int] = []

    def open_camera() -> Camera:
        calls.append(1)
        if len(calls) > 1:
            return then
        hung.wait(PATIENCE_S)
        return late

    return open_camera, calls


def test_reopening_says_what_it_does_and_gives_up_when_the_time_is_up():
    what = Reopener(Port(fails=99), SimulatedClock(), live=True, for_s=4.0)
    assert what.plan == ""
    plans = set()
    while not what.exhausted:
        what.attempt()
        plans.add(what.plan.partition(" (")[-1])
    # after 0.5 and 2.5 s, and at the end
    assert {"attempt 1, for 4 s more)", "attempt 2, for 3 s more)", "attempt 3, for 1 s more)"} <= plans
    assert (what.plan, what.failure) == ("", "still gone")
    assert what.attempt() is None


def test_an_opening_that_hangs_counts_as_failed_and_its_camera_is_closed_when_it_comes(hung):
    late, good, clock = Camera(), Camera(), SimulatedClock()
    reopen, calls = hangs_first(hung, late, good)
    what = Reopener(reopen, clock, live=True, for_s=60.0)
    with takes(0, SOON_S):
        while not calls:
            assert what.attempt() is None
    clock.sleep_until_ns(clock.now_ns() + round(1e9 * reopening.OPENING_S))
    assert what.attempt() is None
    assert what.failure == "not within 10 s"
    assert attempts(what) is good
    assert not late.closed
    hung.set()
    eventually(lambda: late.closed == 1)
    assert not good.closed


@pytest.mark.usefixtures("quick")
def test_a_camera_that_is_being_opened_when_the_run_ends_is_closed(hung):
    camera = Camera()
    reopen, _ = hangs_first(hung, camera, Camera())
    source = FrameSource(Camera(CameraLost("gone")), reopen, HostClock(), 0.2, lambda: None, 60.0)  # type: ignore[arg-type]
    source.next()
    while "it is being opened again" not in (trouble := source.next()).reason:  # type: ignore[union-attr]
        assert not trouble.ends  # type: ignore[union-attr]
    source.close()
    hung.set()
    eventually(lambda: camera.closed == 1)
    assert "could not be opened" in source.next().reason  # type: ignore[union-attr]


@pytest.mark.usefixtures("quick")
def test_errors_that_a_driver_may_not_raise_pass_through_reopening():
    with pytest.raises(AttributeError, match="typo"):
        attempts(Reopener(raising(AttributeError("typo")), HostClock(), live=True, for_s=60.0))


# Devices


def devices(open_camera: Callable[[], Any], display: Any = None) -> Devices:
    return Devices(Camera(), display or Camera(), HostClock(), open_camera)  # type: ignore[arg-type]


def test_reopening_does_without_the_lost_cameras_close(hung):
    fresh = Camera()
    for close in (lambda: hung.wait(PATIENCE_S), raising(RuntimeError("no device"))):
        what = devices(lambda: fresh)
        what.camera.close = close  # type: ignore[method-assign]
        with takes(0, SOON_S):
            assert what.reopen_camera() is fresh  # type: ignore[comparison-overlap]
        assert what.camera is fresh  # type: ignore[comparison-overlap]


def test_a_camera_that_opens_late_does_not_take_the_place_of_a_newer_one(hung):
    late, newer = Camera(), Camera()
    open_camera, calls = hangs_first(hung, late, newer)
    what = devices(open_camera)
    opening = in_thread("opening", what.reopen_camera)
    eventually(lambda: len(calls) == 1)
    assert what.reopen_camera() is newer  # type: ignore[comparison-overlap]
    hung.set()
    assert opening.result(PATIENCE_S) is late  # type: ignore[comparison-overlap]
    what.close()
    assert newer.closed == 1


@pytest.mark.parametrize("which", ["camera", "display", "both"])
def test_devices_that_hang_when_closed_are_left_within_their_time(which, hung):
    what = devices(Camera)
    for name in ("camera", "display"):
        if which in {name, "both"}:
            getattr(what, name).close = lambda: hung.wait(PATIENCE_S)
    with takes(0, SOON_S), pytest.raises(MeasurementError, match="cannot be closed: not within"):
        what.close(CLOSING_S)


def test_a_device_that_cannot_be_closed_is_reported_and_the_other_closed_all_the_same():
    what = devices(Camera)
    what.camera.close = raising(RuntimeError("busy"))  # type: ignore[method-assign]
    with pytest.raises(MeasurementError, match=r"^camera: cannot be closed: busy$"):
        what.close()
    assert what.display.closed == 1  # type: ignore[attr-defined]


def test_windows_are_closed_in_the_callers_thread():
    where: list[threading.Thread] = []
    for name in ("poll", "other"):
        display = Camera()
        setattr(display, name, lambda: None)
        display.close = lambda: where.append(threading.current_thread())  # type: ignore[method-assign]
        devices(Camera, display).close()
    assert where[0] is threading.current_thread()
    assert where[1] is not threading.current_thread()
