"""The LCD as a plain window, its pixels grabbed from outside, as a monitor would get them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import moderngl
import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, takes
from numpy.typing import NDArray
from two_monitors import TwoMonitors

from zeromethod import InputError, NodeGrid
from zeromethod.clock import SimulatedClock
from zeromethod.devices.opening import load_driver
from zeromethod.devices.protocols import DisplayLost, DrawingDisplay
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.worker import in_thread

if TYPE_CHECKING:
    from zeromethod.drivers.window import WindowDisplay

    Open = Callable[..., WindowDisplay]

SIZE = (420, 330)
REFRESH_HZ = 50.0
REFRESH_NS = 1e9 / REFRESH_HZ
GRID = NodeGrid((256, 320))


@pytest.fixture
def display(open_window: Open) -> WindowDisplay:
    return open_window(SIZE, REFRESH_HZ)


def grabbed(desktop: TwoMonitors, display: WindowDisplay) -> NDArray[np.uint8]:
    """Blue, green, red of the window's place on the desktop, (rows, cols, 3), row 0 at the top."""
    import glfw

    with display.context:
        # also waits until the server has carried out all that came before
        x, y = glfw.get_window_pos(glfw.get_current_context())
    columns, rows = display.size
    return desktop.grab({"left": x, "top": y, "width": columns, "height": rows})


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


@pytest.mark.parametrize("size", [SIZE, (333, 217)])
def test_a_shown_picture_is_on_the_screen_bit_for_bit_which_was_black(desktop, open_window, size):
    display = open_window(size)
    assert not grabbed(desktop, display).any()
    for image in (speckle(size), speckle(size)[::-1]):
        before_ns = time.monotonic_ns()
        assert before_ns < display.show(image) <= time.monotonic_ns()
        np.testing.assert_array_equal(grabbed(desktop, display), grey(image))


def test_the_drawn_warp_is_on_the_screen_bit_for_bit_and_other_contexts_keep_theirs(
    desktop, display, gl_context
):
    assert isinstance(display, DrawingDisplay)
    other, q = pattern(gl_context)
    expected = other.image(q)
    assert np.ptp(expected) > 100
    with display.context:
        renderer, q = pattern(display.context)
        np.testing.assert_array_equal(renderer.image(q), expected)
    for _ in range(2):
        with gl_context:
            display.draw(lambda framebuffer: renderer.render(framebuffer, q))
            np.testing.assert_array_equal(other.image(q), expected)
    np.testing.assert_array_equal(grabbed(desktop, display), grey(expected))
    with gl_context:
        display.close()
        np.testing.assert_array_equal(other.image(q), expected)


def test_a_picture_of_another_shape_is_refused(display):
    with pytest.raises(
        InputError, match=r"^picture: shape \(330, 421\), uint8: allowed \(330, 420\), uint8$"
    ):
        display.show(np.zeros((330, 421), np.uint8))


# a swap that blocks does so for no whole refresh here, so that waiting twice would show
@pytest.mark.parametrize(("swap", "apart"), [(0.01, 1.0), (0.8, 0.8)], ids=["not blocking", "blocking"])
def test_pictures_come_at_the_refresh_or_when_the_swap_is_done(open_window, monkeypatch, swap, apart):
    """On a clock that only the swaps and the driver's own waiting move."""
    import glfw

    clock, real_swap = SimulatedClock(), glfw.swap_buffers

    def timed_swap(window: object) -> None:
        real_swap(window)
        clock.sleep_until_ns(clock.now_ns() + round(swap * REFRESH_NS))

    monkeypatch.setattr("zeromethod.drivers.window.HostClock", lambda: clock)
    monkeypatch.setattr(glfw, "swap_buffers", timed_swap)
    display, image = open_window(SIZE, REFRESH_HZ), speckle()
    times_ns = [display.show(image) for _ in range(15)]
    np.testing.assert_allclose(np.diff(times_ns), apart * REFRESH_NS, atol=2)  # whole nanoseconds


def _close(glfw: Any, window: Any, _patch: pytest.MonkeyPatch) -> None:
    glfw.set_window_should_close(window, True)


def _resize(glfw: Any, window: Any, _patch: pytest.MonkeyPatch) -> None:
    glfw.set_window_size(window, 400, 300)


def _minimise(glfw: Any, _window: Any, patch: pytest.MonkeyPatch) -> None:
    attribute = glfw.get_window_attrib
    patch.setattr(
        glfw, "get_window_attrib", lambda window, which: which == glfw.ICONIFIED or attribute(window, which)
    )


def _break(glfw: Any, _window: Any, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(glfw, "swap_buffers", lambda _window: glfw.window_hint(-1, 0))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (_close, "it was closed"),
        (_resize, "it is 400 x 300 px instead of 420 x 330"),
        (_minimise, "it was minimised"),
        (_break, "Invalid window hint 0xFFFFFFFF"),
    ],
)
def test_a_window_that_cannot_serve_is_a_lost_display_in_one_line(display, monkeypatch, fault, words):
    import glfw

    display.show(speckle())
    with display.context:
        fault(glfw, glfw.get_current_context(), monkeypatch)
    with pytest.raises(DisplayLost, match=f"^display window: {words}$"):
        display.show(speckle())


def test_closing_twice_is_harmless_and_ends_it(open_window, display):
    for _ in range(2):
        display.close()
    with pytest.raises(DisplayLost, match=r"^display window: it is closed$"):
        display.show(speckle())
    open_window(SIZE).show(speckle())


def test_closing_does_not_wait_for_a_swap_that_hangs(display, monkeypatch):
    import glfw

    swapping, end = threading.Event(), threading.Event()

    def hang(window: object) -> None:
        swapping.set()
        end.wait(PATIENCE_S)

    monkeypatch.setattr(glfw, "swap_buffers", hang)
    drawing = in_thread("drawing", lambda: display.show(speckle()))
    assert swapping.wait(PATIENCE_S)
    with takes(0, SOON_S):
        display.close()
    end.set()
    drawing.exception(PATIENCE_S)


def test_a_failed_opening_leaves_other_windows_alone(desktop, open_window, display):
    with pytest.raises(InputError):
        open_window(SIZE, monitor=7)
    display.show(speckle())
    np.testing.assert_array_equal(grabbed(desktop, display), grey(speckle()))


def test_a_rig_file_finds_it_by_name(desktop):
    from zeromethod.drivers.window import WindowDisplay

    assert load_driver("display", "window") is WindowDisplay
