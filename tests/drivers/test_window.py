"""The LCD as a window, on a virtual screen whose pixels can be looked at from outside.

Xvfb keeps its screen in a file, so what is compared is what a monitor would get.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.clock import SimulatedClock
from zeromethod.devices.opening import load_driver
from zeromethod.devices.protocols import DisplayLost, DrawingDisplay
from zeromethod.errors import InputError
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.warp.grid import NodeGrid

if TYPE_CHECKING:
    from zeromethod.drivers.window import WindowDisplay

    Open = Callable[..., WindowDisplay]

SCREEN = (640, 480)
SIZE = (420, 330)
REFRESH_HZ = 50.0
REFRESH_NS = 1e9 / REFRESH_HZ
GRID = NodeGrid((256, 320))
NO_SCREEN = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}

pytestmark = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="Xvfb is not installed")


@pytest.fixture(scope="module")
def screen_file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """File in which a virtual screen keeps its pixels; DISPLAY names the screen."""
    folder = tmp_path_factory.mktemp("screen")
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", f"{SCREEN[0]}x{SCREEN[1]}x24"]
    command += ["-fbdir", str(folder), "-nolisten", "tcp", "+extension", "GLX"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        number = server.stdout.readline().strip()  # written once the server takes connections
        assert number, "Xvfb did not start"
        try:
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("DISPLAY", f":{number}")
                patch.setenv("LIBGL_ALWAYS_SOFTWARE", "1")
                patch.setenv("XDG_SESSION_TYPE", "x11")  # glfw chooses its library by it, when imported
                patch.delenv("WAYLAND_DISPLAY", raising=False)
                import glfw

                yield folder / "Xvfb_screen0"
                glfw.terminate()  # Xlib ends the process if the server goes first
        finally:
            server.terminate()


@pytest.fixture
def open_window(screen_file: Path) -> Iterator[Open]:
    from zeromethod.drivers.window import WindowDisplay

    displays = []

    def open_it(
        size: tuple[int, int] = SIZE, refresh_hz: float = REFRESH_HZ, monitor: int | None = None
    ) -> WindowDisplay:
        displays.append(WindowDisplay(*size, refresh_hz, monitor))
        return displays[-1]

    yield open_it
    for display in displays:
        display.close()


def seen(file: Path, display: WindowDisplay) -> NDArray[np.uint8]:
    """Blue, green, red of the window's place on the screen, (rows, cols, 3), row 0 at the top."""
    import glfw

    with display.context:
        # also waits until the server has carried out all that came before
        x, y = glfw.get_window_pos(glfw.get_current_context())
    data = file.read_bytes()
    header = np.frombuffer(data[:100], ">u4")  # X window dump, version 7
    length, rows, bytes_per_line, colours = (int(header[i]) for i in (0, 5, 12, 19))
    pixels = np.frombuffer(data, np.uint8, rows * bytes_per_line, offset=length + 12 * colours)
    columns, lines = display.size
    return pixels.reshape(rows, -1, 4)[y : y + lines, x : x + columns, :3]


def speckle(size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """Every code, nothing alike in any direction."""
    return np.random.default_rng(3).integers(0, 256, size[::-1], dtype=np.uint8)


def grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.repeat(image[..., None], 3, axis=2)


def pattern(context: moderngl.Context) -> tuple[PatternRenderer, NDArray[np.float64]]:
    """Renderer of this context and a dented warp to draw."""
    u, v = GRID.mesh()
    rest = np.stack([50 + 0.9 * u + 0.04 * v, 30 + 0.95 * v - 0.02 * u], axis=-1)
    bump = 20 * np.exp(-((u - 160) ** 2 + (v - 128) ** 2) / (2 * 32.0**2))
    renderer = PatternRenderer(context, GRID, rest, SIZE, Target("cosines"), Response(2.2))
    return renderer, rest + bump[..., None] * np.array([1.0, 0.7])


def test_the_drawn_warp_is_on_the_screen_bit_for_bit(open_window: Open, screen_file: Path) -> None:
    display = open_window()
    assert isinstance(display, DrawingDisplay)
    with display.context:
        renderer, q = pattern(display.context)
        image = renderer.image(q)
    display.draw(lambda framebuffer: renderer.render(framebuffer, q))
    assert np.ptp(image) > 100
    np.testing.assert_array_equal(seen(screen_file, display), grey(image))


def test_a_shown_picture_is_on_the_screen_bit_for_bit(open_window: Open, screen_file: Path) -> None:
    display = open_window()
    for image in (speckle(), speckle()[::-1]):
        display.show(image)
        np.testing.assert_array_equal(seen(screen_file, display), grey(image))


def test_odd_sizes_are_pixel_exact_too(open_window: Open, screen_file: Path) -> None:
    display = open_window((333, 217))
    display.show(speckle((333, 217)))
    np.testing.assert_array_equal(seen(screen_file, display), grey(speckle((333, 217))))


def test_full_screen_fills_its_monitor(open_window: Open, screen_file: Path) -> None:
    display = open_window(SCREEN, monitor=0)
    display.show(speckle(SCREEN))
    np.testing.assert_array_equal(seen(screen_file, display), grey(speckle(SCREEN)))


def test_it_is_black_before_the_first_picture(open_window: Open, screen_file: Path) -> None:
    assert not seen(screen_file, open_window()).any()


def test_a_picture_of_another_shape_is_refused(open_window: Open) -> None:
    with pytest.raises(
        InputError, match=r"^picture: shape \(330, 421\), uint8: allowed \(330, 420\), uint8$"
    ):
        open_window().show(np.zeros((330, 421), np.uint8))


def swaps_that_take(share: float, monkeypatch: pytest.MonkeyPatch) -> SimulatedClock:
    """Let swaps last `share` of a refresh on a clock that only they and the driver's own waiting move."""
    import glfw

    clock, swap = SimulatedClock(), glfw.swap_buffers

    def timed_swap(window: object) -> None:
        swap(window)
        clock.sleep_until_ns(clock.now_ns() + round(share * REFRESH_NS))

    monkeypatch.setattr("zeromethod.drivers.window.HostClock", lambda: clock)
    monkeypatch.setattr(glfw, "swap_buffers", timed_swap)
    return clock


def test_pictures_come_at_the_refresh_where_the_swap_does_not_block(
    open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    swaps_that_take(0.01, monkeypatch)
    display, image = open_window(), speckle()
    times_ns = [display.show(image) for _ in range(15)]
    np.testing.assert_allclose(np.diff(times_ns), REFRESH_NS, atol=2)  # whole nanoseconds


def test_a_swap_that_blocks_is_not_waited_for_twice(
    open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    swaps_that_take(0.8, monkeypatch)  # not a whole refresh, so that pacing would show
    display, image = open_window(), speckle()
    times_ns = [display.show(image) for _ in range(15)]
    np.testing.assert_allclose(np.diff(times_ns), 0.8 * REFRESH_NS, atol=2)


def test_times_are_the_hosts(open_window: Open) -> None:
    before_ns = time.monotonic_ns()
    assert before_ns < open_window().show(speckle()) <= time.monotonic_ns()


def test_a_closed_window_is_a_lost_display(open_window: Open) -> None:
    import glfw

    display = open_window()
    display.show(speckle())
    with display.context:
        glfw.set_window_should_close(glfw.get_current_context(), True)
    with pytest.raises(DisplayLost, match=r"^display window: it was closed$"):
        display.show(speckle())


def test_a_window_of_another_size_is_a_lost_display(open_window: Open) -> None:
    import glfw

    display = open_window()
    with display.context:
        glfw.set_window_size(glfw.get_current_context(), 400, 300)
    with pytest.raises(DisplayLost, match=r"^display window: it is 400 x 300 px instead of 420 x 330$"):
        display.show(speckle())


def test_what_glfw_reports_is_a_lost_display_in_one_line(
    open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    import glfw

    display = open_window()

    def fails(window: object) -> None:
        glfw.window_hint(-1, 0)

    monkeypatch.setattr(glfw, "swap_buffers", fails)
    with pytest.raises(DisplayLost, match=r"^display window: Invalid window hint 0xFFFFFFFF$"):
        display.show(speckle())


def test_closing_twice_is_harmless_and_ends_it(open_window: Open) -> None:
    display = open_window()
    display.close()
    display.close()
    with pytest.raises(DisplayLost, match=r"^display window: it is closed$"):
        display.show(speckle())
    open_window().show(speckle())


def test_other_contexts_keep_theirs(
    open_window: Open, screen_file: Path, gl_context: moderngl.Context
) -> None:
    other, q = pattern(gl_context)
    expected = other.image(q)
    display = open_window()
    with display.context:
        renderer, q = pattern(display.context)
    for _ in range(2):
        with gl_context:
            display.draw(lambda framebuffer: renderer.render(framebuffer, q))
            np.testing.assert_array_equal(other.image(q), expected)
    np.testing.assert_array_equal(seen(screen_file, display), grey(expected))
    with gl_context:
        display.close()
        np.testing.assert_array_equal(other.image(q), expected)


@pytest.mark.parametrize("index", [1, -1])
def test_an_unknown_monitor_is_refused_with_those_there_are(open_window: Open, index: int) -> None:
    listed = r"0 \(screen, 640 x 480, at 0, 0\)"
    with pytest.raises(InputError, match=rf"^display\.monitor: {index}: allowed: {listed}$"):
        open_window(monitor=index)


def test_a_monitor_of_another_size_is_refused(open_window: Open) -> None:
    with pytest.raises(
        InputError, match=r"^display\.monitor: 0: set to 640 x 480; the rig's display is 420 x 330 px$"
    ):
        open_window(monitor=0)


def test_a_failed_opening_leaves_other_windows_alone(open_window: Open, screen_file: Path) -> None:
    display = open_window()
    with pytest.raises(InputError):
        open_window(monitor=7)
    display.show(speckle())
    np.testing.assert_array_equal(seen(screen_file, display), grey(speckle()))


def test_a_rig_file_finds_it_by_name(screen_file: Path) -> None:
    from zeromethod.drivers.window import WindowDisplay

    assert load_driver("display", "window") is WindowDisplay


OPENING = """
from zeromethod.drivers.window import WindowDisplay
from zeromethod.errors import InputError
try:
    WindowDisplay(64, 48, 60.0)
except InputError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("display", "message"),
    [
        ({}, "display window: no screen: DISPLAY is not set"),
        ({"DISPLAY": ":99999"}, "display window: X11: Failed to open display :99999"),
    ],
)
def test_importing_needs_no_screen_and_opening_names_what_is_missing(
    display: dict[str, str], message: str
) -> None:
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", OPENING],
        env=NO_SCREEN | {"XDG_SESSION_TYPE": "x11"} | display,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (run.stdout, run.stderr) == (message + "\n", "")
