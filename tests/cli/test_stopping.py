"""How a run on devices of one's own ends: signals, keys, a closed window, with a camera that hangs."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import live_devices
import pytest
from small_rigs import BENCH_160, small_rig_file

from zeromethod.cli.stopping import accept_ctrl_c, stopped_by_signals

PATIENCE_S = 60.0

HUNG_LAB = f"""
import os, sys, threading
from pathlib import Path
sys.path.insert(0, {str(Path(live_devices.__file__).parent)!r})
from live_devices import RealEye, RealScreen
from zeromethod.devices.protocols import DisplayLost

for_ever = threading.Event().wait

class HungEye(RealEye):
    def read(self, timeout_s):
        if self.reads >= 12:
            Path("hung").touch()
            for_ever()
        return super().read(timeout_s)

    def close(self):
        for_ever()

class Steady(RealEye):
    def read(self, timeout_s):
        if self.reads >= 12:
            Path("hung").touch()
        return super().read(timeout_s)

class NeverOpen:
    def __init__(self, rows, columns):
        Path("hung").touch()
        for_ever()

class HungScreen(RealScreen):
    def show(self, image):
        if self.shown >= 12:
            Path("hung").touch()
            for_ever()
        return super().show(image)

    def close(self):
        for_ever()

class Window(RealScreen):
    def poll(self):
        if Path("closed").exists():
            raise DisplayLost("its window was closed")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working directory with a lab's module and its rig file; frames may take 30 s."""
    (tmp_path / "our_lab.py").write_text(HUNG_LAB)
    values = {
        **BENCH_160,
        "camera.exposure_s": 0.004,
        "display.scanout_s": 0.0,
        "display.rise_s": 0.0,
        "control.timeout_s": 30.0,
    }
    for display in ("Window", "HungScreen"):
        given = values | {"display.driver": f"our_lab:{display}"}
        small_rig_file(tmp_path / f"{display}.toml", given)
    return tmp_path


@contextmanager
def running(
    folder: Path, camera: str, display: str = "Window", terminal: int | None = None
) -> Iterator[subprocess.Popen[str]]:
    """`zeromethod run` in the folder, once its device hangs; terminal: file descriptor of its own."""

    def take_terminal() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    command = "from zeromethod.cli.main import main; main()"
    arguments = ["--rig", f"{display}.toml", "--camera", f"our_lab:{camera}"]
    process = subprocess.Popen(
        [sys.executable, "-c", command, "run", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL if terminal is None else terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=None if terminal is None else take_terminal,  # noqa: PLW1509 - two system calls
    )
    try:
        end_s = time.monotonic() + PATIENCE_S
        while not (folder / "hung").exists():
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < end_s
            time.sleep(0.02)
        time.sleep(0.1)
        yield process
    finally:
        process.kill()
        process.communicate()


def ended(process: subprocess.Popen[str]) -> tuple[int, float, str]:
    """(exit code, seconds until then, what it wrote on standard error)."""
    started = time.monotonic()
    _, told = process.communicate(timeout=PATIENCE_S)
    return process.returncode, time.monotonic() - started, told


@pytest.mark.parametrize(
    ("camera", "display", "number"),
    [
        ("HungEye", "Window", signal.SIGINT),
        ("HungEye", "Window", signal.SIGTERM),
        ("NeverOpen", "Window", signal.SIGTERM),
        ("Steady", "HungScreen", signal.SIGINT),
    ],
)
def test_signals_end_a_run_within_a_second_whatever_hangs(
    folder: Path, camera: str, display: str, number: signal.Signals
) -> None:
    with running(folder, camera, display) as process:
        process.send_signal(number)
        code, seconds, told = ended(process)
    assert code == 130, told
    assert seconds < 1, told
    assert "Traceback" not in told


def test_a_closed_window_ends_a_run_with_its_reason_though_the_camera_hangs(folder: Path) -> None:
    with running(folder, "HungEye") as process:
        (folder / "closed").touch()
        code, seconds, told = ended(process)
    assert code == 1
    assert seconds < 1
    assert "zeromethod: measurement failed: fault: the display is lost: its window was closed" in told
    assert "Traceback" not in told


def test_q_in_the_terminal_ends_a_run(folder: Path) -> None:
    keyboard, side = pty.openpty()
    with running(folder, "Steady", terminal=side) as process:
        os.write(keyboard, b"q")
        code, seconds, told = ended(process)
        left = termios.tcgetattr(side)[3]
    os.close(keyboard)
    os.close(side)
    assert code == 0, told
    assert seconds < 1
    assert left & termios.ICANON
    assert left & termios.ECHO


def test_the_first_signal_asks_and_the_second_insists() -> None:
    asked: list[int] = []

    def interrupt() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)

    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with stopped_by_signals(lambda: asked.append(1)):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        assert asked == [1]
        with pytest.raises(KeyboardInterrupt):
            interrupt()
        assert asked == [1]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_handlers_are_put_back_when_a_run_fails() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(ZeroDivisionError), stopped_by_signals(lambda: None):
        raise ZeroDivisionError
    assert signal.getsignal(signal.SIGTERM) is before


def test_ctrl_c_is_heard_where_a_script_has_it_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        accept_ctrl_c()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_handler_of_ones_own_stays() -> None:
    before = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        own = signal.getsignal(signal.SIGINT)
        accept_ctrl_c()
        assert signal.getsignal(signal.SIGINT) is own
    finally:
        signal.signal(signal.SIGINT, before)
