"""The LCD as a full-screen window on one of two monitors, its pixels grabbed from outside."""

from __future__ import annotations

import ctypes
import subprocess
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, eventually, takes
from numpy.typing import NDArray
from two_monitors import TwoMonitors

from zeromethod.devices.protocols import DisplayLost
from zeromethod.errors import InputError
from zeromethod.worker import in_thread

if TYPE_CHECKING:
    import moderngl

    from zeromethod.drivers.window import WindowDisplay

    Open = Callable[..., WindowDisplay]

REFRESH_HZ = 60.0
PERIOD_NS = 1e9 / REFRESH_HZ


@pytest.fixture
def display(desktop: TwoMonitors, open_window: Open) -> WindowDisplay:
    return open_window(desktop.sizes[1], REFRESH_HZ, 1)


def grab(desktop: TwoMonitors, monitor: int) -> NDArray[np.uint8]:
    return desktop.grab(desktop.region(monitor))


def speckle(display: WindowDisplay, seed: int = 3) -> NDArray[np.uint8]:
    """Every code, nothing alike in any direction."""
    return np.random.default_rng(seed).integers(0, 256, display.size[::-1], dtype=np.uint8)


def poll_until_lost(display: WindowDisplay) -> str:
    """Poll as the loop does; what the display's loss was said to be."""
    said: list[str] = []

    def lost() -> bool:
        try:
            display.poll()
        except DisplayLost as error:
            said.append(str(error))
        return bool(said)

    eventually(lost)
    return said[0]


def fill(code: int, delay_s: float = 0.0) -> object:
    def render(framebuffer: moderngl.Framebuffer) -> None:
        time.sleep(delay_s)
        framebuffer.clear(code / 255, code / 255, code / 255)

    return render


def test_lcd_and_projector_show_their_pictures_at_once_each_on_its_monitor(desktop, display):
    from zeromethod.drivers.projector_window import ProjectorWindow

    projector = ProjectorWindow(0, REFRESH_HZ)
    try:
        speckled = speckle(display)
        projected = np.full((240, 320), 90, np.uint8)

        def both_shown() -> bool:
            display.show(speckled)
            projector.show(projected)
            projector.poll()
            lcd, surface = grab(desktop, 1), grab(desktop, 0)
            return bool((lcd == speckled[..., None]).all() and (surface == 90).all())

        eventually(both_shown)
        assert not projector.trouble
    finally:
        projector.close()


def test_the_chosen_monitor_shows_the_picture_bit_for_bit_and_the_other_nothing(desktop, display):
    other = grab(desktop, 0)
    for seed in (3, 4):
        image = speckle(display, seed)
        display.show(image)
        np.testing.assert_array_equal(grab(desktop, 1), np.repeat(image[..., None], 3, axis=2))
    np.testing.assert_array_equal(grab(desktop, 0), other)


def test_another_thread_draws_while_the_main_one_polls(desktop, display):
    display.show(speckle(display))  # the first picture may well come from the main thread
    image = speckle(display, 7)

    def draw() -> list[int]:
        return [*(display.draw(fill(code)) for code in range(30)), display.show(image)]

    drawing = in_thread("drawing", draw)
    while not drawing.done():
        display.poll()
        time.sleep(0.001)
    times_ns = drawing.result()
    assert np.all(np.diff(times_ns) > 0)
    np.testing.assert_array_equal(grab(desktop, 1)[..., 0], image)
    display.show(speckle(display))  # and the last one too
    np.testing.assert_array_equal(grab(desktop, 1)[..., 0], speckle(display))


def test_a_thread_that_draws_learns_that_the_display_is_lost(desktop, display):
    def draw() -> None:
        while True:
            display.draw(fill(9))

    drawing = in_thread("drawing", draw)
    desktop.xrandr("--output", "DUMMY1", "--off")
    assert poll_until_lost(display) == str(drawing.exception(PATIENCE_S))
    assert isinstance(drawing.exception(), DisplayLost)


def best_share(phases: NDArray[np.float64], width: float) -> float:
    """Largest share of phases (periods) within `width` of one phase."""
    apart = np.abs((phases[:, None] - phases + 0.5) % 1 - 0.5)
    return float((apart <= width).mean(axis=1).max())


def test_presentations_sit_on_the_refreshes(display):
    """Swaps do not block here, so the refreshes are the clock's.

    A busy machine makes pictures late, never early, so what is asked for survives that: no more pictures
    than refreshes, and a quarter of them within 5 % of a period (0.8 ms) of one phase. Of 120 pictures at
    any times 12 lie within 5 % of a given phase, hardly ever more than 22 of the best (mean and 3 sigma).
    That all of them do on a machine with time to spare is shown on a simulated clock (test_refresh.py);
    a machine that has none at all is given time.
    """

    def on_the_refreshes() -> bool:
        times_ns = np.array([display.draw(fill(code)) for code in range(135)])[15:]  # see _ROW
        assert times_ns[-1] - times_ns[0] > (len(times_ns) - 2) * PERIOD_NS  # the first may be late by one
        return best_share(times_ns / PERIOD_NS, 0.05) > 0.25

    eventually(on_the_refreshes)
    assert any("swaps do not wait" in said for said in display.warnings)


def test_a_late_picture_drops_refreshes(display):
    """At least the refreshes missed by drawing for 2.5 periods, unless a busy machine asks too late."""
    display.draw(fill(1))

    def missed() -> int:
        before = display.dropped_refreshes
        display.draw(fill(2, delay_s=2.5 * PERIOD_NS * 1e-9))
        return display.dropped_refreshes - before

    eventually(lambda: missed() >= 2)


def test_a_monitor_switched_off_is_a_lost_display(desktop, display):
    display.show(speckle(display))
    desktop.xrandr("--output", "DUMMY1", "--off")
    assert poll_until_lost(display) == "display window: it lost its monitor"
    with pytest.raises(DisplayLost, match=r"^display window: it lost its monitor$"):
        display.show(speckle(display))


def test_a_monitor_that_moved_or_changed_its_mode_is_a_lost_display(desktop, display):
    display.show(speckle(display))
    desktop.xrandr("--output", "DUMMY1", "--pos", "0x480")
    assert "at 640, 0 of the desktop; its monitor is at 0, 480" in poll_until_lost(display)


ALLOWED = "allowed: 0 (DUMMY0, 640 x 480, 60.00 Hz, at 0, 0), 1 (DUMMY1, 800 x 600, 60.00 Hz, at 640, 0)"


@pytest.mark.parametrize(
    ("size", "refresh_hz", "monitor", "message"),
    [
        ((800, 600), 60.0, 7, f"7: {ALLOWED}"),
        ((800, 600), 60.0, -1, f"-1: {ALLOWED}"),
        ((420, 330), 60.0, 0, "0: set to 640 x 480; the rig's display is 420 x 330 px"),
        ((800, 600), 75.0, 1, "1: set to 60.00 Hz; the rig's display has 75 Hz"),
    ],
)
def test_monitors_that_are_unknown_or_set_otherwise_are_refused(
    open_window, size, refresh_hz, monitor, message
):
    with pytest.raises(InputError) as refused:
        open_window(size, refresh_hz, monitor)
    assert str(refused.value) == f"display.monitor: {message}"


def test_a_clean_desktop_gives_no_warning_but_that_of_unpaced_swaps(display):
    assert [said for said in display.warnings if "swaps do not wait" not in said] == []
    assert not display.asleep


def test_mirrored_outputs_are_reported(desktop):
    from zeromethod.drivers.monitors import monitors

    desktop.xrandr("--output", "DUMMY1", "--pos", "0x0")
    for monitor, other in zip(monitors(), ("DUMMY1", "DUMMY0"), strict=True):
        assert monitor.warnings == (
            f"{monitor.name}: {other} shows the same part of the desktop (mirrored outputs)",
        )


def test_night_mode_is_reported_also_when_it_comes_during_the_run(desktop, display, monkeypatch):
    monkeypatch.setattr("zeromethod.drivers.window._LOOK_AGAIN_S", 0.05)
    desktop.xrandr("--output", "DUMMY1", "--gamma", "1:0.9:0.7")
    said: list[str] = []

    def found() -> bool:
        display.poll()
        said[:] = [line for line in display.warnings if "gamma ramp" in line]
        return bool(said)

    eventually(found)
    # code^(1/0.7) lies at most 12 % of full scale below code: 0.7^(0.7/0.3) - 0.7^(1/0.3) = 0.435 - 0.305
    assert said[0].startswith("DUMMY1: its gamma ramp changes greys by up to 13% (night mode")


def test_the_monitors_are_listed_as_they_are_set(desktop):
    from zeromethod.drivers.monitors import Monitor, monitors

    assert monitors() == (
        Monitor(0, "DUMMY0", 640, 480, pytest.approx(60, abs=0.01), 0, 0, 1.0, True),
        Monitor(1, "DUMMY1", 800, 600, pytest.approx(60, abs=0.01), 640, 0, 1.0, False),
    )
    desktop.xrandr("--output", "DUMMY1", "--off")
    assert [monitor.name for monitor in monitors()] == ["DUMMY0"]


def saver_is_on() -> bool:
    """Whether the screen saver has come on, as the X server reports."""
    from zeromethod.drivers.xserver import XServer

    server, info = (
        XServer(),
        (ctypes.c_int * 16)(),
    )  # XScreenSaverInfo of scrnsaver.h: window (two ints), state
    query = ctypes.CDLL("libXss.so.1").XScreenSaverQueryInfo
    query.argtypes = (ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p)
    query(server._server, server._x11.XDefaultRootWindow(server._server), info)
    server.close()
    return info[2] == 1


def test_the_screen_saver_stays_off_while_a_window_is_open(desktop, open_window):
    """In a plain window: for full-screen ones glfw turns the timer off, too."""
    subprocess.run(["xset", "s", "1", "1"], env=desktop.environment, check=True, timeout=10)
    try:
        display = open_window((64, 48))
        time.sleep(1.5)
        assert not saver_is_on()
        display.close()
        eventually(saver_is_on)
        open_window((64, 48))  # opening lights the screen again
        assert not saver_is_on()
    finally:
        subprocess.run(["xset", "s", "0"], env=desktop.environment, check=True, timeout=10)


def test_an_lcd_asleep_is_reported(display, monkeypatch):
    """The dummy driver has no power saving, so that the server's answer is made up."""
    monkeypatch.setattr("zeromethod.drivers.window._LOOK_AGAIN_S", 0.0)
    monkeypatch.setattr("zeromethod.drivers.xserver.XServer.asleep", lambda server: "standby")
    display.poll()
    assert display.asleep
    assert display.warnings[0] == "the LCD is asleep (power saving: standby)"


def test_each_monitor_identifies_itself_until_a_key_is_pressed(desktop, monkeypatch):
    import glfw

    from zeromethod.drivers import identify
    from zeromethod.drivers.monitors import monitors

    callbacks, grabbed = [], []
    monkeypatch.setattr(glfw, "set_key_callback", lambda window, callback: callbacks.append(callback))

    def press(_seconds: float) -> None:
        grabbed.extend(grab(desktop, monitor)[..., 0] for monitor in (0, 1))
        callbacks[-1](None, glfw.KEY_SPACE, 0, glfw.PRESS, 0)

    monkeypatch.setattr(identify, "time", SimpleNamespace(monotonic=time.monotonic, sleep=press))
    known = monitors()
    identified = identify.identify(seconds=60)
    assert [one.monitor for one in identified] == list(known)
    for monitor, picture in zip(known, grabbed, strict=True):
        np.testing.assert_array_equal(picture, identify.identify_picture(monitor))


def test_one_monitor_identifies_itself_for_a_time(desktop):
    from zeromethod.drivers.identify import identify

    with takes(0.2, SOON_S):
        assert [one.monitor.name for one in identify(0.2, index=1)] == ["DUMMY1"]
    with pytest.raises(InputError, match=r"^--identify: 2: allowed: 0 \(DUMMY0, .*1 \(DUMMY1, "):
        identify(0.2, index=2)
