"""A desktop with two monitors and no hardware: Xorg on its dummy driver, one process per desktop.

A started desktop is left to the caller: pass `environment` to the processes that are to see it, and grab
its pixels with mss. Starting takes about 0.2 s.
"""

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

SIZES = ((640, 480), (800, 600))
"""Columns and rows of the monitors, where nothing else is asked for."""
REFRESH_HZ = 60.0
OUTPUTS = ("DUMMY0", "DUMMY1")

_CONFIGURATION = Path(__file__).with_name("xorg-dummy.conf")
_DRIVERS = ("/usr/lib/xorg/modules/drivers", "/usr/lib64/xorg/modules/drivers")
_BLANKING = (80, 20)
"""Columns and rows of a mode that are not seen."""


def missing() -> str:
    """What has to be installed for two monitors, in words; "" when all is there."""
    packages = {"Xorg": "xserver-xorg-core", "xrandr": "x11-xserver-utils"}
    lacking = [package for tool, package in packages.items() if shutil.which(tool) is None]
    if not any(Path(folder, "dummy_drv.so").exists() for folder in _DRIVERS):
        lacking.append("xserver-xorg-video-dummy")
    return f"not installed: {', '.join(lacking)}" if lacking else ""


@dataclass(frozen=True)
class TwoMonitors:
    """A running desktop: DUMMY0 (primary) at 0, 0 and DUMMY1 to its right. `display` is its DISPLAY."""

    display: str
    sizes: Sequence[tuple[int, int]]

    @property
    def environment(self) -> dict[str, str]:
        """This process's environment, for one that is to live on this desktop."""
        kept = {name: value for name, value in os.environ.items() if name != "WAYLAND_DISPLAY"}
        return kept | self.variables

    @property
    def variables(self) -> dict[str, str]:
        """What differs there. glfw chooses its library by the session's type when it is imported."""
        return {"DISPLAY": self.display, "LIBGL_ALWAYS_SOFTWARE": "1", "XDG_SESSION_TYPE": "x11"}

    def region(self, monitor: int) -> dict[str, int]:
        """Where a monitor lies, as mss takes it: left, top, width, height, px."""
        columns, rows = self.sizes[monitor]
        return {"left": sum(c for c, _ in self.sizes[:monitor]), "top": 0, "width": columns, "height": rows}

    def grab(self, place: dict[str, int]) -> NDArray[np.uint8]:
        """Blue, green, red of a part of the desktop, (rows, cols, 3); `place` as of `region`."""
        import mss

        with mss.MSS(display=self.display) as grabber:
            return np.array(grabber.grab(place), np.uint8)[..., :3]

    def xrandr(self, *arguments: str) -> None:
        """Change the outputs (DUMMY0, DUMMY1) by xrandr."""
        command = ["xrandr", *arguments]
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, check=False, timeout=10
        )
        assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"

    def arrange(self) -> None:
        """Put both monitors side by side at their sizes, with linear gamma ramps, as after the start."""
        arguments: list[str] = []
        for monitor, (output, (columns, rows)) in enumerate(zip(OUTPUTS, self.sizes, strict=True)):
            left = self.region(monitor)["left"]
            arguments += ["--output", output, "--mode", _mode(columns, rows), "--pos", f"{left}x0"]
            arguments += ["--gamma", "1:1:1"] + ["--primary"] * (monitor == 0)
        self.xrandr(*arguments)
        self.xrandr("--query")  # an output counts as connected once it is probed after its first mode


@contextmanager
def start(
    folder: Path, sizes: Sequence[tuple[int, int]] = SIZES, refresh_hz: float = REFRESH_HZ
) -> Iterator[TwoMonitors]:
    """Start a desktop on a free display number; stop it at the end.

    folder: for its log. sizes: (columns, rows) of both monitors, px. Skips the test where something is not
    installed. Close glfw (`glfw.terminate()`) before the end where this process used it: Xlib ends the
    process if the server goes first.
    """
    if lacking := missing():
        pytest.skip(lacking)
    reading, writing = os.pipe()
    # else the server outlives a test run that is killed
    leash = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
    command = [*leash, "Xorg", "-displayfd", str(writing), "-config", str(_CONFIGURATION)]
    command += ["-logfile", str(folder / "Xorg.log"), "-noreset", "-nolisten", "tcp", "-ac"]
    command += ["-s", "0", "+extension", "GLX", "+extension", "RANDR"]
    with (
        open(folder / "Xorg.out", "wb") as output,
        subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, pass_fds=[writing]) as server,
    ):
        os.close(writing)
        try:
            with os.fdopen(reading) as answer:
                number = answer.readline().strip()  # written once the server takes connections
            assert number, f"Xorg did not start: {(folder / 'Xorg.out').read_text(errors='replace')}"
            desktop = TwoMonitors(f":{number}", tuple(sizes))
            for name, size in zip(OUTPUTS, sizes, strict=True):
                _add_mode(desktop, name, size, refresh_hz)
            desktop.arrange()
            yield desktop
        finally:
            server.terminate()


def _add_mode(desktop: TwoMonitors, output: str, size: tuple[int, int], refresh_hz: float) -> None:
    (columns, rows), (dark_columns, dark_rows) = size, _BLANKING
    clock_mhz = (columns + dark_columns) * (rows + dark_rows) * refresh_hz * 1e-6
    timing = [columns, columns + 16, columns + 48, columns + dark_columns]
    timing += [rows, rows + 3, rows + 8, rows + dark_rows]
    if output == OUTPUTS[0] or desktop.sizes[0] != desktop.sizes[1]:
        desktop.xrandr("--newmode", _mode(columns, rows), f"{clock_mhz:.6f}", *map(str, timing))
    desktop.xrandr("--addmode", output, _mode(columns, rows))


def _mode(columns: int, rows: int) -> str:
    return f"{columns}x{rows}-test"  # names like 640x480 are the driver's own


@pytest.fixture(scope="session")
def two_monitors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TwoMonitors]:
    """One desktop of the default sizes for all tests; a test that rearranges it puts it back (`arrange`)."""
    with start(tmp_path_factory.mktemp("two-monitors")) as desktop:
        yield desktop
