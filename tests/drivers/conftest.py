"""A desktop with two monitors for the tests of windows; glfw is imported on it."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from two_monitors import TwoMonitors, two_monitors

__all__ = ["two_monitors"]


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
def open_window(desktop: TwoMonitors) -> Iterator[Callable[..., Any]]:
    """Opens a `WindowDisplay`, which is closed at the end."""
    from zeromethod.drivers.window import WindowDisplay

    displays = []

    def open_it(size: tuple[int, int], refresh_hz: float = 60.0, monitor: int | None = None) -> WindowDisplay:
        displays.append(WindowDisplay(*size, refresh_hz, monitor))
        return displays[-1]

    yield open_it
    for display in displays:
        display.close()


@pytest.fixture
def open_camera() -> Iterator[Callable[..., Any]]:
    """Opens an `OpenCVCamera` of 160 x 128 px, which is closed at the end."""
    from zeromethod.drivers.opencv_camera import OpenCVCamera

    cameras = []

    def opened(source: int | str, **options: Any) -> OpenCVCamera:
        settings = {"columns": 160, "rows": 128, "bits": 8, "rate_hz": 60.0, "exposure_s": 0.004}
        cameras.append(OpenCVCamera(source=source, **(settings | options)))
        return cameras[-1]

    yield opened
    for camera in cameras:
        camera.close()
