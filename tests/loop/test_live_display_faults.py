"""Every fault of the display in a closed loop: it is named, the warp holds, it ends well."""

from __future__ import annotations

import threading
import time

import pytest
from live_bench import GOOD, bench, both_times, held, notes, raising
from live_devices import Window

from zeromethod.devices.protocols import DisplayLost
from zeromethod.loop.events import Event
from zeromethod.loop.state import State


@pytest.mark.parametrize(("real", "display"), [(False, "Screen"), (True, "Window"), (True, "Canvas")])
def test_a_display_lost_while_drawing_ends_the_run(real: bool, display: str) -> None:
    with bench(real, display) as b:
        b.screen.before_show = raising(DisplayLost("the window is closed"))
        steps = b.to_end()
        assert steps[-1].state is State.FAULT
        assert steps[-1].events == (Event.DISPLAY_LOST,)
        assert steps[-1].reason == "the display is lost: the window is closed"


def test_a_monitor_unplugged_is_noticed_while_the_camera_is_waited_for() -> None:
    with bench(real=True) as b:
        b.eye.before_read = b.hang
        b.screen.on_poll = raising(DisplayLost("monitor 1 is unplugged"))
        started = time.monotonic()
        step = b.loop.step()
        assert time.monotonic() - started < 1
        assert (step.state, step.events) == (State.FAULT, (Event.DISPLAY_LOST,))
        assert "monitor 1 is unplugged" in step.reason
        assert b.loop.over
        assert b.screen.polled_in is threading.main_thread()


@pytest.mark.parametrize("display", ["Window", "Canvas"])
def test_a_display_that_hangs_is_given_up_after_its_timeout(display: str) -> None:
    with bench(real=True, display=display) as b:
        b.screen.before_show = b.hang
        started = time.monotonic()
        steps = b.to_end()
        assert time.monotonic() - started < 3
        assert steps[-1].events == (Event.DISPLAY_LOST,)
        assert "it has been showing one picture for 0." in steps[-1].reason
        started = time.monotonic()
        b.loop.close()
        assert time.monotonic() - started < 1


@both_times
def test_a_display_driver_that_breaks_is_named(real: bool) -> None:
    with bench(real) as b:
        b.screen.before_show = raising(ZeroDivisionError("swap"))
        steps = b.to_end()
        assert steps[-1].events == (Event.DEVICE_BROKEN,)
        assert "ZeroDivisionError in live_bench.py" in steps[-1].reason


def test_a_display_whose_state_cannot_be_asked_for_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    with bench(real=True) as b:
        monkeypatch.setattr(Window, "asleep", property(raising(OSError("no display"))), raising=False)
        steps = b.to_end()
        assert steps[-1].events == (Event.DEVICE_BROKEN,)
        assert "no display" in steps[-1].reason


def test_a_display_that_sleeps_is_waited_for() -> None:
    with bench(real=True) as b:
        before = b.loop.step()
        b.screen.asleep = True
        steps = [b.loop.step() for _ in range(4)]
        assert all(step.state is State.HOLDING and step.reason == "the LCD is asleep" for step in steps)
        assert all(Event.DISPLAY_ASLEEP in step.events for step in steps)
        assert held(steps, steps[0])
        assert notes(steps) == "the LCD is asleep"
        assert before.state in GOOD
        b.screen.asleep = False
        b.settle()


def test_what_a_display_warns_of_is_told_once() -> None:
    with bench(real=True) as b:
        b.screen.warnings = ("outputs are mirrored", "night mode is on")
        steps = [b.loop.step() for _ in range(4)]
        assert notes(steps) == "outputs are mirrored\nnight mode is on"
        assert steps[0].events == (Event.DISPLAY_WARNING,) * 2
        assert all(step.state in GOOD for step in steps)


def test_a_picture_that_was_wiped_off_is_drawn_again_though_the_camera_sees_no_light() -> None:
    with bench(real=True) as b:
        b.loop.pause()
        for _ in range(10):  # what was on its way has been shown
            b.loop.step()
        # as a screen saver does, or another window that goes away: black, until somebody draws
        with b.screen.lock:
            b.screen.pictures = [(time_ns, 0 * light) for time_ns, light in b.screen.pictures]
        shown = b.screen.shown
        b.until(lambda step: step.reason == "the light is off")
        b.loop.pause(False)
        b.settle()
        assert b.screen.shown > shown
