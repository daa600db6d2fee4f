"""`zeromethod devices` as a person meets it: the list, and the three ways of setting up."""

import fcntl
import json
import os
import pty
import re
import select
import signal
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from command_line import Outcome, run, start
from small_rigs import BENCH_160, small_rig_file
from two_monitors import TwoMonitors, missing
from two_monitors import start as start_desktop

from zeromethod import Rig, load_rig
from zeromethod.drivers.listing import Found, Listing, Missing
from zeromethod.drivers.monitors import Monitor
from zeromethod.rig.save import save_values

MONITORS = (
    Monitor(0, "eDP-1", 2560, 1440, 144.0, 0, 0, 1.0, primary=True),
    Monitor(1, "HDMI-1", 1920, 1080, 0.0, 2560, 0, 1.5, primary=False, warnings=("HDMI-1: scaled",)),
)
LISTING = Listing(
    cameras=(Found("0", "USB camera"), Found("pylon:40012345", "acA1300-60gm")),
    missing=(Missing("aravis", "GigE Vision and USB3 Vision cameras", "apt install libaravis-0.8-0"),),
    problems=("pylon: no answer within 5 s",),
)
needs_two_monitors = pytest.mark.skipif(bool(missing()), reason=missing())


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """The packaged bench with an eighth of the camera's pixels on each axis and a quarter of the LCD's."""
    return small_rig_file(tmp_path / "my.toml", BENCH_160)


def test_monitors_and_cameras_are_listed_as_run_takes_them_and_what_is_missing_for_more(
    monkeypatch, tmp_path
):
    monkeypatch.setattr("zeromethod.drivers.monitors.monitors", lambda: MONITORS)
    monkeypatch.setattr("zeromethod.drivers.listing.cameras", lambda: LISTING)
    code, out, err = run("devices", "--summary", tmp_path / "found.json")
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    assert ["0", "eDP-1", "2560", "x", "1440", "144.00", "Hz", "0,", "0", "primary"] in lines
    assert ["1", "HDMI-1", "1920", "x", "1080", "not", "known", "2560,", "0"] in lines
    assert ["pylon:40012345", "acA1300-60gm"] in lines
    for line in (
        "! HDMI-1: scaled",
        "! pylon: no answer within 5 s",
        "for GigE Vision and USB3 Vision cameras (aravis): apt install libaravis-0.8-0",
    ):
        assert line in out.splitlines()
    found = json.loads((tmp_path / "found.json").read_text())
    assert [monitor["name"] for monitor in found["monitors"]] == ["eDP-1", "HDMI-1"]
    assert [camera["address"] for camera in found["cameras"]] == ["0", "pylon:40012345"]
    assert found["missing"][0]["install"] == "apt install libaravis-0.8-0"


def test_without_a_screen_the_cameras_are_listed_all_the_same(monkeypatch, tmp_path):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("zeromethod.drivers.listing.cameras", lambda: LISTING)
    code, out, err = run("devices", "--summary", tmp_path / "found.json")
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == "no monitors: no screen: DISPLAY is not set"
    assert "USB camera" in out
    assert json.loads((tmp_path / "found.json").read_text())["monitors"] == []


@pytest.mark.parametrize(("drawing_per_s", "code"), [(90.0, 0), (21.0, 1)])
def test_speed_says_whether_this_computer_is_fast_enough_and_which_part_is_slowest(
    drawing_per_s, code, rig_file, tmp_path, monkeypatch
):
    def measured(rig: Rig, folder: Path, advance: Callable[[str], None]) -> dict[str, Any]:
        assert (rig.control.strips, folder) == ("edges", Path.cwd())
        rates = {"loop": 200.0, "drawing": drawing_per_s, "reading": 100.0, "recording": 150.0}
        parts: dict[str, Any] = {
            name: {"frames_per_s": rate, "fast_enough": rate >= 60.0} for name, rate in rates.items()
        }
        parts["loop"]["ms"] = {"median": 4.0, "p90": 5.0, "p99": 6.0}
        parts["recording"]["megabytes_per_s"] = 321.0
        advance("")
        return {
            "rig": rig.name, "frame_px": [160, 128], "camera_rate_hz": 60.0, "cores": 4,
            "gl_renderer": "a card", "parts": parts, "bottleneck": "drawing", "fast_enough": code == 0,
        }  # fmt: skip

    monkeypatch.setattr("zeromethod.session.speed.measure_speed", measured)
    summary = tmp_path / "speed.json"
    ended, out, err = run("devices", "--speed", "--rig", rig_file, "--summary", summary)
    assert (ended, err) == (code, "")
    assert "160x128 px, 60 frames/s, 16.7 ms each; 4 cores, drawn by a card" in out
    lines = [line.split() for line in out.splitlines()]
    assert ["frame", "in", "to", "warp", "out", "4.0", "5.0", "200", "–", "fast", "enough"] in lines
    assert ["recording", "everything", "–", "–", "150", "321", "fast", "enough"] in lines
    assert ("too slow: the picture follows late" in out) is (code == 1)
    words = "fast enough" if code == 0 else "NOT fast enough"
    assert out.splitlines()[-1] == (
        f"this computer is {words} for 60 frames/s: the slowest part, drawing the pattern, "
        f"manages {drawing_per_s:.0f}"
    )
    assert json.loads(summary.read_text())["fast_enough"] is (code == 0)


def test_a_planted_delay_comes_back_in_words_and_is_stored_with_the_rig_file(rig_file, tmp_path):
    save_values(rig_file, {"display.latency_s": 0.0213})
    arguments = ("devices --delay --seconds 0.5 --rig", rig_file)
    code, out, err = run(*arguments)
    assert (code, err) == (0, "")
    first, *lines = out.splitlines()
    assert first == "rig 'simulated' is simulated: real devices are named by --display and --camera"
    assert lines[0].startswith("delay 21.3")
    assert lines[0].endswith("(1.28 camera frames; the rig says 21.30 ms)")
    assert "the panel's first row begins to change so long after the presentation time" in lines[1]
    margin = next(line for line in lines if line.startswith("stability: "))
    assert "controller 'composition' with gain 1 is stable; the gain could be" in margin
    assert lines[-1] == "add --write to store it in the rig file"

    before = rig_file.read_text()
    assert "# " in before
    code, out, _ = run(*arguments, "--write", "--summary", tmp_path / "delay.json")
    assert code == 0
    keys = "display.latency_s, display.scanout_s, display.scan, display.rise_s"
    assert out.splitlines()[-1] == f"stored as {keys} in {rig_file}"
    figures = json.loads((tmp_path / "delay.json").read_text())
    stored_s = load_rig(rig_file).display.latency_s
    assert stored_s == pytest.approx(figures["latency_s"], abs=1e-6)
    # the bar is 0.1 frame, 1.7 ms; the clocks' jitter is 0.1 ms in each frame, of which there are 30
    assert stored_s == pytest.approx(0.0213, abs=1e-4)
    assert figures["stability_margin"] > 1
    assert figures["stored"] is True
    # the packaged panel's, by frames of 16 changes
    display = load_rig(rig_file).display
    assert display.scanout_s == pytest.approx(1 / display.refresh_hz, abs=5e-4)
    assert display.rise_s == pytest.approx(load_rig("simulated").display.rise_s, abs=5e-4)
    assert display.scan == "down"
    # the rest of the file stays, comments and all
    after = rig_file.read_text()
    measured = re.compile("^(latency_s|scan|rise_s).*\n", re.MULTILINE)
    assert measured.sub("", after) == measured.sub("", before)


def test_a_delay_that_cannot_be_measured_is_exit_code_1_and_nothing_is_stored(rig_file):
    save_values(rig_file, {"simulation.peak_grey_share": 0.02})
    before = rig_file.read_text()
    code, out, err = run("devices --delay --write --seconds 0.3 --rig", rig_file)
    assert code == 1
    assert "delay" not in out
    assert err.startswith("zeromethod: measurement failed: delay: the codes of 0 of ")
    assert rig_file.read_text() == before


def test_focus_shows_the_figures_and_what_to_do(rig_file, tmp_path):
    save_values(rig_file, {"simulation.ambient": 0.2})
    summary = tmp_path / "focus.json"
    code, out, err = run("devices --focus --seconds 0.3 --rig", rig_file, "--summary", summary)
    assert (code, err) == (0, "")
    for words in ("focus score", "by region", "grey levels", "saturated", "usable of that", "flicker"):
        assert words in out
    assert "-> stray light, 20% of the LCD's: darken the room, shade the prism" in out
    figures = json.loads(summary.read_text())
    assert figures["focus_score"] > 0.9
    assert figures["lcd"]["stray_share"] == pytest.approx(0.2, abs=0.01)
    assert figures["picture"]["wider"] == pytest.approx(0, abs=1e-3)
    assert len(figures["advice"]) == 1


def test_focus_on_a_simulated_bench_ends_by_itself_once_it_has_all_figures(rig_file, tmp_path):
    summary = tmp_path / "focus.json"
    assert run("devices --focus --rig", rig_file, "--summary", summary).code == 0
    figures = json.loads(summary.read_text())
    assert figures["time_s"] < 0.3  # 16 frames, of which flicker is read
    assert figures["flicker_share"] < 0.01


def test_focus_ends_on_q_with_the_terminal_as_before(rig_file, tmp_path):
    """In a terminal of its own, where the table renews itself in place."""
    leader, follower = pty.openpty()
    process = start(
        "devices --focus --seconds 1000 --summary focus.json --rig", rig_file, cwd=tmp_path,
        stdin=follower, stdout=follower, stderr=follower, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        env=os.environ | {"TERM": "xterm", "COLUMNS": "120", "LINES": "40"},
    )  # fmt: skip
    os.close(follower)
    shown = b""
    try:
        until = time.monotonic() + 60
        while b"q ends" not in shown and time.monotonic() < until:
            if select.select([leader], [], [], 1)[0]:
                shown += os.read(leader, 65536)
        assert b"focus score" in shown
        os.write(leader, b"q")
        while process.poll() is None and time.monotonic() < until:
            if select.select([leader], [], [], 0.1)[0]:
                try:
                    os.read(leader, 65536)
                except OSError:  # the terminal's other end is closed
                    break
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait()
        os.close(leader)
    assert json.loads((tmp_path / "focus.json").read_text())["focus_score"] > 0.9


def test_focus_keeps_the_last_figures_on_sigterm(rig_file, tmp_path):
    process = start("devices --focus --seconds 1000 --summary focus.json --rig", rig_file, cwd=tmp_path)
    assert "is simulated" in process.stdout.readline()
    assert "focus" in process.stdout.readline()  # the first frame's line
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.strip() == "interrupted"
    assert "focus score" in out
    assert json.loads((tmp_path / "focus.json").read_text())["focus_score"] > 0.9


@pytest.fixture(scope="module")
def desktop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TwoMonitors]:
    with start_desktop(tmp_path_factory.mktemp("desktop"), ((640, 480), (1280, 800))) as monitors:
        yield monitors


def on(desktop: TwoMonitors, line: str, **options: Any) -> Outcome:
    """A command in a process of its own on that desktop."""
    with start(line, env=desktop.environment, **options) as process:
        out, err = process.communicate(timeout=60)
    return Outcome(process.returncode, out, err)


@needs_two_monitors
def test_the_monitors_of_a_desktop_are_listed_and_identified(desktop):
    listed = on(desktop, "devices").out.splitlines()
    assert listed[1].split() == ["0", "DUMMY0", "640", "x", "480", "60.00", "Hz", "0,", "0", "primary"]
    assert listed[2].split() == ["1", "DUMMY1", "1280", "x", "800", "60.00", "Hz", "640,", "0"]
    shown = on(desktop, "devices --identify --seconds 0.2")
    assert (shown.code, shown.err) == (0, "")
    assert [line for line in shown.out.splitlines() if line.startswith("monitor ")] == [
        "monitor 0 (DUMMY0, 640 x 480, 60.00 Hz, at 0, 0)",
        "monitor 1 (DUMMY1, 1280 x 800, 60.00 Hz, at 640, 0)",
    ]


@needs_two_monitors
def test_focus_on_a_real_monitor_sees_the_lcd_through_the_virtual_bench(desktop, tmp_path):
    pytest.importorskip("mss")
    line = "virtual-bench --port 0 --scenario none --forever"
    bench = start(line, env=desktop.environment, stderr=None)
    assert bench.stdout is not None
    try:
        camera = next(line.split()[-1] for line in bench.stdout if "tcp://" in line)
        line = f"devices --focus --rig virtual --display 1 --camera {camera} --seconds 0.5 --summary f.json"
        done = on(desktop, line, cwd=tmp_path)
    finally:
        bench.send_signal(signal.SIGINT)
        bench.communicate(timeout=60)
    assert (done.code, done.err) == (0, "")
    figures = json.loads((tmp_path / "f.json").read_text())
    assert figures["focus_score"] > 0.9
    assert figures["lcd"]["seen_share"] > 0.99
    assert not figures["lcd"]["mirrored"]
    assert figures["advice"] == ["good: focus, light and view are as they should be"]
