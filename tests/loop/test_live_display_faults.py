"""Every fault of the display in a closed loop: it is named, the warp stays, it ends well."""

import re
import threading
from types import SimpleNamespace
from unittest.mock import Mock, patch

import pytest
from hanging import SOON_S, eventually, raising, takes
from live_bench import GOOD, bench, frozen, notes
from live_devices import Window, small_rig

from zeromethod import Event, Loop, State
from zeromethod.clock import HostClock
from zeromethod.devices.protocols import DisplayLost
from zeromethod.rig.tables import ControlSpec


@pytest.mark.parametrize(("real", "display"), [(False, "Screen"), (True, "Window"), (True, "Canvas")])
def test_a_display_lost_while_drawing_ends_the_run(real, display):
    with bench(real, display) as b:
        b.screen.before_show = raising(DisplayLost("the window is closed"))
        last = b.to_end()[-1]
        assert (last.state, last.events[-1]) == (State.FAULT, Event.DISPLAY_LOST)
        assert last.reason == "the display is lost: the window is closed"


@pytest.mark.parametrize("off_s", [1.0, -1.0])
def test_a_presentation_time_that_cannot_be_ends_the_run(either, off_s):
    show = either.screen.show
    either.screen.show = lambda image: show(image) + round(1e9 * off_s)  # type: ignore[method-assign]
    last = either.to_end()[-1]
    assert (last.state, last.events[-1]) == (State.FAULT, Event.DEVICE_BROKEN)
    assert "show() gave a presentation time" in last.reason


def test_a_monitor_unplugged_is_noticed_while_the_camera_is_waited_for(real):
    real.eye.before_read = real.hang
    real.screen.on_poll = raising(DisplayLost("monitor 1 is unplugged"))
    with takes(0, SOON_S):
        step = real.loop.step()
    assert (step.state, step.events) == (State.FAULT, (Event.DISPLAY_LOST,))
    assert "monitor 1 is unplugged" in step.reason
    assert real.loop.over
    assert real.screen.polled_in is threading.main_thread()


@pytest.mark.parametrize("display", ["Window", "Canvas"])
def test_a_display_that_hangs_is_given_up_after_its_timeout(display):
    with bench(real=True, display=display) as b:
        b.screen.before_show = b.hang
        b.loop._screen._drawing._timeout_s = 0.2
        with takes(0, SOON_S):
            last = b.to_end()[-1]
        assert last.events[-1] is Event.DISPLAY_LOST
        assert re.search(r"it has been showing one picture for \d+\.\d s", last.reason)
        with takes(0, SOON_S):
            b.loop.close()


def test_a_picture_is_waited_for_longer_than_a_frame():
    rig = small_rig()
    rig = rig.replace({"control.timeout_s": ControlSpec().timeout_s})
    with patch("zeromethod.loop.loop.Drawing") as drawing, Loop(rig, Mock(), SimpleNamespace(), HostClock()):
        # seen on two busy cores without a GPU: 1.6 s
        assert drawing.call_args.args[2] > 2 * 1.6


def test_a_display_whose_state_cannot_be_asked_for_ends_the_run(real, monkeypatch):
    monkeypatch.setattr(Window, "asleep", property(raising(OSError("no display"))), raising=False)
    last = real.to_end()[-1]
    assert last.events[-1] is Event.DEVICE_BROKEN
    assert "no display" in last.reason


def test_a_display_that_sleeps_is_waited_for(real):
    assert real.loop.step().state in GOOD
    real.screen.asleep = True
    steps = real.step(4)
    assert all((step.state, step.reason) == (State.HOLDING, "the LCD is asleep") for step in steps)
    assert all(Event.DISPLAY_ASLEEP in step.events for step in steps)
    assert frozen(steps, steps[0])
    assert notes(steps) == "the LCD is asleep"
    real.screen.asleep = False
    real.settle()


def test_warnings_of_a_display_are_shown_once(real):
    real.screen.warnings = ("outputs are mirrored", "night mode is on")
    steps = real.step(4)
    assert notes(steps) == "outputs are mirrored\nnight mode is on"
    assert steps[0].events.count(Event.DISPLAY_WARNING) == 2
    real.screen.warnings = ("outputs are mirrored", "desktop scaling")
    steps += real.step(2)
    assert notes(steps[-2:]) == "desktop scaling"
    assert all(step.state in GOOD for step in steps)


def test_a_picture_that_was_wiped_off_is_drawn_again_though_the_camera_receives_no_light(real):
    real.loop.pause()
    real.step(2)
    drawing = real.loop._screen._drawing._worker
    eventually(lambda: not drawing._waiting and not drawing.busy_s)  # what was on its way has been shown
    # as a screen saver does, or another window that goes away: black, until somebody draws
    with real.screen.lock:
        real.screen.pictures = [(time_ns, 0 * light) for time_ns, light in real.screen.pictures]
    shown = real.screen.shown
    real.until(lambda step: step.reason == "the light is off")
    real.loop.pause(False)
    real.settle()
    assert real.screen.shown > shown
