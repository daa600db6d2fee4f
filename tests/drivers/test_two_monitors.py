"""The LCD as a full-screen window on one of two monitors, its pixels grabbed from outside."""

from __future__ import annotations

import ctypes
import subprocess
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from two_monitors import TwoMonitors, two_monitors

from zeromethod.devices.protocols import DisplayLost
from zeromethod.errors import InputError

if TYPE_CHECKING:
    import moderngl

    from zeromethod.drivers.window import WindowDisplay

__all__ = ["two_monitors"]

REFRESH_HZ = 60.0
PERIOD_NS = 1e9 / REFRESH_HZ


@pytest.fixture(scope="module")
def _desktop(two_monitors: TwoMonitors) -> Iterator[TwoMonitors]:
    """The desktop, with this process on it."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in two_monitors.variables.items():
            patch.setenv(name, value)
        patch.delenv("WAYLAND_DISPLAY", raising=False)
        import glfw

        yield two_monitors
        glfw.terminate()


@pytest.fixture
def desktop(_desktop: TwoMonitors) -> Iterator[TwoMonitors]:
    """The desktop as after its start, also after a test that rearranges it."""
    yield _desktop
    _desktop.arrange()


@pytest.fixture
def display(desktop: TwoMonitors) -> Iterator[WindowDisplay]:
    from zeromethod.drivers.window import WindowDisplay

    display = WindowDisplay(*desktop.sizes[1], REFRESH_HZ, monitor=1)
    yield display
    display.close()


def grab(desktop: TwoMonitors, monitor: int) -> NDArray[np.uint8]:
    """Blue, green, red of a monitor, (rows, cols, 3)."""
    import mss

    with mss.MSS(display=desktop.display) as grabber:
        return np.array(grabber.grab(desktop.region(monitor)), np.uint8)[..., :3]


def speckle(display: WindowDisplay, seed: int = 3) -> NDArray[np.uint8]:
    """Every code, nothing alike in any direction."""
    return np.random.default_rng(seed).integers(0, 256, display.size[::-1], dtype=np.uint8)


def poll_until_lost(display: WindowDisplay, patience_s: float = 5.0) -> str:
    """Poll as the loop does; what the display's loss was said to be."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        try:
            display.poll()
        except DisplayLost as error:
            return str(error)
        time.sleep(0.01)
    pytest.fail("the display was not lost")


def fill(code: int, delay_s: float = 0.0) -> object:
    def render(framebuffer: moderngl.Framebuffer) -> None:
        time.sleep(delay_s)
        framebuffer.clear(code / 255, code / 255, code / 255)

    return render


def test_the_chosen_monitor_shows_the_picture_bit_for_bit_and_the_other_nothing(
    desktop: TwoMonitors, display: WindowDisplay
) -> None:
    other = grab(desktop, 0)
    for seed in (3, 4):
        image = speckle(display, seed)
        display.show(image)
        np.testing.assert_array_equal(grab(desktop, 1), np.repeat(image[..., None], 3, axis=2))
    np.testing.assert_array_equal(grab(desktop, 0), other)


def test_another_thread_draws_while_the_main_one_polls(desktop: TwoMonitors, display: WindowDisplay) -> None:
    display.show(speckle(display))  # the first picture may well come from the main thread
    image, times_ns, failed = speckle(display, 7), [], []

    def draw() -> None:
        try:
            times_ns.extend(display.draw(fill(code)) for code in range(30))
            times_ns.append(display.show(image))
        except Exception as error:
            failed.append(error)

    drawing = threading.Thread(target=draw)
    drawing.start()
    while drawing.is_alive():
        display.poll()
        time.sleep(0.001)
    drawing.join()
    assert not failed
    assert len(times_ns) == 31
    assert np.all(np.diff(times_ns) > 0)
    np.testing.assert_array_equal(grab(desktop, 1)[..., 0], image)
    display.show(speckle(display))  # and the last one too
    np.testing.assert_array_equal(grab(desktop, 1)[..., 0], speckle(display))


def test_a_thread_that_draws_learns_that_the_display_is_lost(
    desktop: TwoMonitors, display: WindowDisplay
) -> None:
    said: list[str] = []

    def draw() -> None:
        try:
            while True:
                display.draw(fill(9))
        except DisplayLost as error:
            said.append(str(error))

    drawing = threading.Thread(target=draw, daemon=True)
    drawing.start()
    desktop.xrandr("--output", "DUMMY1", "--off")
    lost = poll_until_lost(display)
    drawing.join(5)
    assert said == [lost]


def best_share(phases: NDArray[np.float64], width: float) -> float:
    """Largest share of phases (periods) within `width` of one phase."""
    apart = np.abs((phases[:, None] - phases + 0.5) % 1 - 0.5)
    return float((apart <= width).mean(axis=1).max())


def test_presentations_sit_on_the_refreshes(display: WindowDisplay) -> None:
    """Swaps do not block here, so the refreshes are the clock's.

    A busy machine makes pictures late, never early, so what is asked for survives that: no more pictures
    than refreshes, and a quarter of them within 5 % of a period (0.8 ms) of one phase. Of 120 pictures at
    any times 12 lie within 5 % of a given phase, hardly ever more than 22 of the best (mean and 3 sigma).
    That all of them do on a machine with time to spare is shown on a simulated clock (test_refresh.py).
    """
    times_ns = np.array([display.draw(fill(code)) for code in range(135)])[15:]  # see _ROW
    assert any("swaps do not wait" in said for said in display.warnings)
    assert times_ns[-1] - times_ns[0] > (len(times_ns) - 2) * PERIOD_NS  # the first may be late by one
    assert best_share(times_ns / PERIOD_NS, 0.05) > 0.25


def test_a_late_picture_drops_refreshes(display: WindowDisplay) -> None:
    """At least the refreshes missed by drawing for 2.5 periods; a busy machine may miss more."""
    display.draw(fill(1))
    before = display.dropped_refreshes
    display.draw(fill(2, delay_s=2.5 * PERIOD_NS * 1e-9))
    assert display.dropped_refreshes - before >= 2


def test_a_monitor_switched_off_is_a_lost_display(desktop: TwoMonitors, display: WindowDisplay) -> None:
    display.show(speckle(display))
    desktop.xrandr("--output", "DUMMY1", "--off")
    assert poll_until_lost(display) == "display window: it lost its monitor"
    with pytest.raises(DisplayLost, match=r"^display window: it lost its monitor$"):
        display.show(speckle(display))


def test_a_monitor_that_moved_or_changed_its_mode_is_a_lost_display(
    desktop: TwoMonitors, display: WindowDisplay
) -> None:
    display.show(speckle(display))
    desktop.xrandr("--output", "DUMMY1", "--pos", "0x480")
    assert "at 640, 0 of the desktop; its monitor is at 0, 480" in poll_until_lost(display)


def test_a_minimised_window_is_a_lost_display(
    display: WindowDisplay, monkeypatch: pytest.MonkeyPatch
) -> None:
    import glfw

    attribute = glfw.get_window_attrib
    monkeypatch.setattr(
        glfw, "get_window_attrib", lambda window, which: which == glfw.ICONIFIED or attribute(window, which)
    )
    assert poll_until_lost(display) == "display window: it was minimised"


def test_an_unknown_monitor_is_refused_with_the_list(desktop: TwoMonitors) -> None:
    from zeromethod.drivers.window import WindowDisplay

    with pytest.raises(InputError) as refused:
        WindowDisplay(*desktop.sizes[1], REFRESH_HZ, monitor=7)
    assert str(refused.value) == (
        "display.monitor: 7: allowed: 0 (DUMMY0, 640 x 480, 60.00 Hz, at 0, 0), "
        "1 (DUMMY1, 800 x 600, 60.00 Hz, at 640, 0)"
    )


def test_a_monitor_at_another_rate_is_refused(desktop: TwoMonitors) -> None:
    from zeromethod.drivers.window import WindowDisplay

    with pytest.raises(
        InputError, match=r"^display\.monitor: 1: set to 60\.00 Hz; the rig's display has 75 Hz$"
    ):
        WindowDisplay(*desktop.sizes[1], 75.0, monitor=1)


def test_a_clean_desktop_gives_no_warning_but_that_of_unpaced_swaps(display: WindowDisplay) -> None:
    assert [said for said in display.warnings if "swaps do not wait" not in said] == []
    assert not display.asleep


def test_mirrored_outputs_are_told(desktop: TwoMonitors) -> None:
    from zeromethod.drivers.monitors import monitors

    desktop.xrandr("--output", "DUMMY1", "--pos", "0x0")
    for monitor, other in zip(monitors(), ("DUMMY1", "DUMMY0"), strict=True):
        assert monitor.warnings == (
            f"{monitor.name}: {other} shows the same part of the desktop (mirrored outputs)",
        )


def test_night_mode_is_told_also_when_it_comes_during_the_run(
    desktop: TwoMonitors, display: WindowDisplay, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zeromethod.drivers.window._LOOK_AGAIN_S", 0.05)
    desktop.xrandr("--output", "DUMMY1", "--gamma", "1:0.9:0.7")
    until = time.monotonic() + 5
    while not (said := [line for line in display.warnings if "gamma ramp" in line]):
        assert time.monotonic() < until
        display.poll()
    # code^(1/0.7) lies at most 12 % of full scale below code: 0.7^(0.7/0.3) - 0.7^(1/0.3) = 0.435 - 0.305
    assert said[0].startswith("DUMMY1: its gamma ramp changes greys by up to 13% (night mode")


def test_the_monitors_are_listed_as_they_are_set(desktop: TwoMonitors) -> None:
    from zeromethod.drivers.monitors import Monitor, monitors

    assert monitors() == (
        Monitor(0, "DUMMY0", 640, 480, pytest.approx(60, abs=0.01), 0, 0, 1.0, True),
        Monitor(1, "DUMMY1", 800, 600, pytest.approx(60, abs=0.01), 640, 0, 1.0, False),
    )
    desktop.xrandr("--output", "DUMMY1", "--off")
    assert [monitor.name for monitor in monitors()] == ["DUMMY0"]


def saver_is_on(desktop: TwoMonitors) -> bool:
    """Whether the screen saver has come on, as the X server tells."""

    class Info(ctypes.Structure):  # scrnsaver.h
        _fields_ = (
            ("window", ctypes.c_ulong),
            ("state", ctypes.c_int),
            ("kind", ctypes.c_int),
            ("times", ctypes.c_ulong * 2),
            ("events", ctypes.c_ulong),
        )

    x11, saver = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXss.so.1")
    x11.XOpenDisplay.restype, x11.XDefaultRootWindow.restype = ctypes.c_void_p, ctypes.c_ulong
    x11.XDefaultRootWindow.argtypes = x11.XCloseDisplay.argtypes = (ctypes.c_void_p,)
    saver.XScreenSaverQueryInfo.argtypes = (ctypes.c_void_p, ctypes.c_ulong, ctypes.POINTER(Info))
    server, info = x11.XOpenDisplay(desktop.display.encode()), Info()
    saver.XScreenSaverQueryInfo(server, x11.XDefaultRootWindow(server), ctypes.byref(info))
    x11.XCloseDisplay(server)
    return info.state == 1


def test_the_screen_saver_is_held_off_while_a_window_is_open(desktop: TwoMonitors) -> None:
    """In a plain window: for full-screen ones glfw turns the timer off, too."""
    from zeromethod.drivers.window import WindowDisplay

    subprocess.run(["xset", "s", "1", "1"], env=desktop.environment, check=True, timeout=10)
    try:
        display = WindowDisplay(64, 48, REFRESH_HZ)
        time.sleep(1.5)
        assert not saver_is_on(desktop)
        display.close()
        until = time.monotonic() + 5
        while not saver_is_on(desktop):
            assert time.monotonic() < until
            time.sleep(0.05)
        display = WindowDisplay(64, 48, REFRESH_HZ)  # opening lights the screen again
        assert not saver_is_on(desktop)
        display.close()
    finally:
        subprocess.run(["xset", "s", "0"], env=desktop.environment, check=True, timeout=10)


def test_an_lcd_asleep_is_told(display: WindowDisplay, monkeypatch: pytest.MonkeyPatch) -> None:
    """The dummy driver has no power saving, so that the server's answer is made up."""
    monkeypatch.setattr("zeromethod.drivers.window._LOOK_AGAIN_S", 0.0)
    monkeypatch.setattr("zeromethod.drivers.xserver.XServer.asleep", lambda server: "standby")
    display.poll()
    assert display.asleep
    assert display.warnings[0] == "the LCD is asleep (power saving: standby)"


def test_closing_does_not_wait_for_a_swap_that_hangs(
    desktop: TwoMonitors, monkeypatch: pytest.MonkeyPatch
) -> None:
    import glfw

    from zeromethod.drivers.window import WindowDisplay

    display, swapping, end = WindowDisplay(64, 48, REFRESH_HZ), threading.Event(), threading.Event()

    def hang(window: object) -> None:
        swapping.set()
        end.wait(10)

    monkeypatch.setattr(glfw, "swap_buffers", hang)
    drawing = threading.Thread(target=display.draw, args=(fill(1),))
    drawing.start()
    assert swapping.wait(5)
    before = time.monotonic()
    display.close()
    assert time.monotonic() - before < 1
    end.set()
    drawing.join(5)
    with pytest.raises(DisplayLost, match=r"^display window: it is closed$"):
        display.draw(fill(2))


def test_each_monitor_identifies_itself_until_a_key_is_pressed(
    desktop: TwoMonitors, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    told = identify.identify(seconds=60)
    assert [one.monitor for one in told] == list(known)
    for monitor, picture in zip(known, grabbed, strict=True):
        np.testing.assert_array_equal(picture, identify.identify_picture(monitor))


def test_one_monitor_identifies_itself_for_a_time(desktop: TwoMonitors) -> None:
    from zeromethod.drivers.identify import identify

    before = time.monotonic()
    assert [one.monitor.name for one in identify(0.2, index=1)] == ["DUMMY1"]
    assert 0.2 < time.monotonic() - before < 5
    with pytest.raises(InputError, match=r"^--identify: 2: allowed: 0 \(DUMMY0, .*1 \(DUMMY1, "):
        identify(0.2, index=2)
