"""How a run on devices of one's own ends: signals, keys, a closed window, with a camera that hangs."""

import fcntl
import os
import pty
import signal
import subprocess
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import live_devices
import pytest
from command_line import start
from hanging import PATIENCE_S, SOON_S, eventually
from small_rigs import BENCH_160, small_rig_file

from zeromethod.cli.stopping import accept_ctrl_c, stopped_by_signals

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
    panel = {"display.scanout_s": 0.0, "display.rise_s": 0.0}
    panel |= {"geometry.known": "exact"}  # else the rest would be measured first
    values = {**BENCH_160, **panel, "camera.exposure_s": 0.004, "control.timeout_s": 30.0}
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
        # under nohup, which the program respects, all that is started ignores it
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    process = start(
        f"run --rig {display}.toml --camera our_lab:{camera}",
        cwd=folder,
        env=os.environ | {"PYTHONFAULTHANDLER": "1"},
        stdin=subprocess.DEVNULL if terminal is None else terminal,
        preexec_fn=None if terminal is None else take_terminal,
    )
    try:
        eventually(lambda: (folder / "hung").exists() or process.poll() is not None, PATIENCE_S)
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.1)
        yield process
    finally:
        process.kill()
        process.communicate()


def ended(process: subprocess.Popen[str]) -> tuple[int, float, str]:
    """(exit code, seconds until then, what it wrote on standard error)."""
    started = time.monotonic()
    try:
        _, err = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # its threads' stacks then stand in what it wrote
        raise AssertionError(process.communicate()[1]) from None
    return process.returncode, time.monotonic() - started, err


@pytest.mark.parametrize(
    ("camera", "display", "number"),
    [
        ("HungEye", "Window", signal.SIGINT),
        ("NeverOpen", "Window", signal.SIGTERM),
        ("Steady", "HungScreen", signal.SIGINT),
    ],
)
def test_signals_end_a_run_whatever_hangs(folder, camera, display, number):
    with running(folder, camera, display) as process:
        process.send_signal(number)
        code, seconds, err = ended(process)
    assert code == 130, err
    assert seconds < SOON_S, err
    assert "Traceback" not in err


def test_a_closed_window_ends_a_run_with_its_reason_though_the_camera_hangs(folder):
    with running(folder, "HungEye") as process:
        (folder / "closed").touch()
        code, seconds, err = ended(process)
    assert code == 1
    assert seconds < SOON_S
    assert "zeromethod: measurement failed: fault: the display is lost: its window was closed" in err
    assert "Traceback" not in err


def test_q_in_the_terminal_ends_a_run(folder):
    keyboard, side = pty.openpty()
    with running(folder, "Steady", terminal=side) as process:
        os.write(keyboard, b"q")
        code, seconds, err = ended(process)
        left = termios.tcgetattr(side)[3]
    os.close(keyboard)
    os.close(side)
    assert code == 0, err
    assert seconds < SOON_S
    assert left & termios.ICANON
    assert left & termios.ECHO


def test_a_terminal_that_is_closed_ends_a_run_in_order(folder):
    keyboard, side = pty.openpty()
    with running(folder, "Steady", terminal=side) as process:
        os.close(side)
        os.close(keyboard)
        code, seconds, err = ended(process)
    assert code == 130, err
    assert seconds < SOON_S
    assert "Traceback" not in err


INTERRUPTED_IMPORT = """
import os, signal, time
os.kill(os.getpid(), signal.{})
time.sleep(30)
"""


@pytest.mark.parametrize("loading", ["click", "numba"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_the_program_is_still_loading_ends_it_in_one_line(tmp_path, number, loading):
    (tmp_path / f"{loading}.py").write_text(INTERRUPTED_IMPORT.format(number.name))
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    # under nohup, which the program respects, all that is started ignores it
    hung_up = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    with start("run", env=os.environ | {"PYTHONPATH": path}, preexec_fn=hung_up) as process:
        out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")


@pytest.mark.parametrize("given", ["0", "-1", "many"])
def test_a_number_of_threads_that_is_none_is_refused_in_one_line(given):
    with start("design simulated", env=os.environ | {"NUMBA_NUM_THREADS": given}) as process:
        out, err = process.communicate(timeout=PATIENCE_S)
    line = f"zeromethod: NUMBA_NUM_THREADS: {given}: a whole number from 1 (in the environment)\n"
    assert (process.returncode, out, err) == (2, "", line)


@pytest.fixture
def ctrl_c() -> Iterator[Callable[[], object]]:
    """The handler of Ctrl-C; what a test sets is put back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield lambda: signal.getsignal(signal.SIGINT)
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_first_signal_asks_and_the_second_insists(ctrl_c):
    asked: list[int] = []

    def interrupt() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(PATIENCE_S)  # the handler ends it at once

    before = ctrl_c(), signal.getsignal(signal.SIGTERM)
    with stopped_by_signals(lambda: asked.append(1)):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        assert asked == [1]
        with pytest.raises(KeyboardInterrupt):
            interrupt()
        assert asked == [1]
    assert (ctrl_c(), signal.getsignal(signal.SIGTERM)) == before
    with pytest.raises(ZeroDivisionError), stopped_by_signals(lambda: None):
        raise ZeroDivisionError
    assert (ctrl_c(), signal.getsignal(signal.SIGTERM)) == before


def test_what_nohup_has_ignored_stays_ignored(ctrl_c):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with stopped_by_signals():
        os.kill(os.getpid(), signal.SIGHUP)
        time.sleep(0.01)
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def own(*_: object) -> None:
    """A handler."""


@pytest.mark.parametrize(
    ("before", "after"), [(signal.SIG_IGN, signal.default_int_handler), (own, own)], ids=["ignored", "own"]
)
def test_ctrl_c_is_accepted_where_a_script_has_it_ignored(ctrl_c, before, after):
    signal.signal(signal.SIGINT, before)
    accept_ctrl_c()
    assert ctrl_c() is after
