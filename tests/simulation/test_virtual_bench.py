"""The virtual bench: its stream, its truth, its rays, and a real X monitor that comes back bent."""

import itertools
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import two_monitors
from command_line import run
from hanging import PATIENCE_S, SOON_S, eventually
from numpy.typing import NDArray

from zeromethod import InputError, binned, load_rig
from zeromethod.resources import resource
from zeromethod.rig.save import save_values
from zeromethod.simulation.loads import rough
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.scenario import load_scenario
from zeromethod.simulation.sensor import Sensor
from zeromethod.simulation.virtual_bench.bench import Bender, Performance
from zeromethod.simulation.virtual_bench.exposure import Exposer, Exposure, merged
from zeromethod.simulation.virtual_bench.stream import FrameServer, stream_header
from zeromethod.simulation.virtual_bench.truth import TruthFile, deepest

COLUMNS, ROWS = 640, 512


def serving(bits: int = 8) -> closing[FrameServer]:
    return closing(FrameServer(0, stream_header(COLUMNS, ROWS, 12.0, bits)))


@contextmanager
def client_of(port: int, buffer: int = 0) -> Iterator[socket.socket]:
    """A plain reader; buffer: bytes that the system may keep for it, 0 = as many as it likes."""
    with socket.socket() as client:
        if buffer:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        client.settimeout(PATIENCE_S)
        client.connect(("127.0.0.1", port))
        yield client


def received(client: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = client.recv(count - len(data))
        assert part, f"the stream ended after {len(data)} of {count} bytes"
        data += part
    return bytes(data)


def received_line(client: socket.socket) -> bytes:
    line = b""
    while not line.endswith(b"\n"):
        line += received(client, 1)
    return line


def received_frame(client: socket.socket, bits: int = 8) -> NDArray[Any]:
    dtype = np.dtype(np.uint8 if bits == 8 else "<u2")
    assert received_line(client) == b"FRAME\n"
    return np.frombuffer(received(client, COLUMNS * ROWS * dtype.itemsize), dtype).reshape(ROWS, COLUMNS)


@pytest.mark.parametrize(("bits", "kind"), [(8, b"mono"), (12, b"mono16")])
def test_a_plain_socket_reader_gets_every_bit(bits, kind):
    rng = np.random.default_rng(1)
    dtype = np.uint8 if bits == 8 else np.uint16
    with serving(bits) as server, client_of(server.port) as client:
        assert received_line(client) == b"YUV4MPEG2 W640 H512 F12:1 Ip A1:1 C" + kind + b"\n"
        for _ in range(3):
            image = rng.integers(0, 2**bits, (ROWS, COLUMNS), dtype=dtype)
            assert server.put(image)
            np.testing.assert_array_equal(received_frame(client, bits), image)


def test_a_rate_that_is_no_whole_number_is_a_fraction():
    assert b" F25:2 " in stream_header(COLUMNS, ROWS, 12.5, 8)


def test_a_slow_reader_gets_the_newest_frame_and_holds_nobody_up():
    with serving() as server, client_of(server.port, buffer=4096) as client:
        eventually(lambda: server.connected)
        started = time.monotonic()
        for number in range(100):
            server.put(np.full((ROWS, COLUMNS), number, np.uint8))
            time.sleep(0.002)
        # 100 pauses of 2 ms; a queue that filled up would have held this up for ever
        assert time.monotonic() - started < PATIENCE_S
        assert received_line(client).startswith(b"YUV4MPEG2")
        # the first was on its way when the reader stopped; of all others only the newest was kept
        assert received_frame(client)[0, 0] < 99
        assert received_frame(client)[0, 0] == 99


def test_a_new_client_is_served_once_the_one_before_has_gone():
    image = np.arange(COLUMNS * ROWS, dtype=np.uint8).reshape(ROWS, COLUMNS)
    with serving() as server:
        assert not server.put(image)  # nobody is there
        for _ in range(2):
            with client_of(server.port) as client:
                assert received_line(client).startswith(b"YUV4MPEG2")
                assert server.put(image)
                np.testing.assert_array_equal(received_frame(client), image)
            eventually(lambda: not server.connected)


def test_closing_ends_a_client_that_does_not_read():
    with serving() as server, client_of(server.port, buffer=4096):
        eventually(lambda: server.connected)
        server.put(np.zeros((ROWS, COLUMNS), np.uint8))
        started = time.monotonic()
        server.close()
        assert time.monotonic() - started < SOON_S


def truth_lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_the_truth_is_written_line_by_line_as_the_press_file_has_it(tmp_path):
    rig = load_rig("virtual")
    scenario = load_scenario(rig.scenario)
    performance = Performance(scenario, loops=2)
    start_ns = 7_000_000_000
    path = tmp_path / "truth.jsonl"
    with TruthFile(path, rig, rig.scenario) as truth:
        head = truth_lines(path)[0]
        assert (head["rig"], head["press"], head["clock"]) == ("virtual", "rehearsal", "monotonic")
        assert head["version"]
        # (second of the scenario, phase, x, depth), worked out from rehearsal.toml by hand
        known = [(-1.0, None, None, 0.0), (2.0, "untouched", None, 0.0), (4.25, "press", 37.0, 0.05)]
        known += [(6.0, "hold", 37.0, 0.2), (11.0, "slide", 42.0, 0.2), (15.0, "settle", 47.0, 0.2)]
        known += [(16.5, "lift", 47.0, 0.1), (19.0, "rest", None, 0.0), (31.0, "slide", 42.0, 0.2)]
        known += [(51.0, None, None, 0.0)]  # both loops are over
        performance.start(start_ns)
        for number, (second, phase, x_mm, depth_mm) in enumerate(known):
            time_ns = start_ns + round(1e9 * second)
            truth.frame(number, time_ns, performance.at(time_ns))
            line = truth_lines(path)[-1]  # there at once
            assert (line["number"], line["time_ns"], line["phase"]) == (number, time_ns, phase)
            assert line["scenario_s"] == (None if second < 0 else pytest.approx(second))
            assert line["peak_depth_mm"] == pytest.approx(depth_mm, abs=1e-12)
            if x_mm is None:
                assert line["presses"] == []
                assert line["peak_x_mm"] is line["peak_y_mm"] is None
            else:
                place = {"x_mm": x_mm, "y_mm": 0.0, "depth_mm": depth_mm}
                assert line["presses"] == [
                    {"shape": "radial"} | {k: pytest.approx(v) for k, v in place.items()}
                ]
                # searched for to 1e-4 mm
                assert (line["peak_x_mm"], line["peak_y_mm"]) == pytest.approx((x_mm, 0.0), abs=2e-4)
    assert len(truth_lines(path)) == 1 + len(known)
    assert not performance.over(start_ns + 39_000_000_000)
    assert performance.over(start_ns + 40_000_000_000)


def test_the_deepest_point_of_what_is_rough_is_found():
    dent = rough(40.0, 1.0, 0.1, 8.0, 0.5, 7)
    found = deepest(Mirror((dent,)))
    assert found.depth_mm == pytest.approx(0.1, rel=1e-4)
    assert float(Mirror((dent,)).depth(found.x_mm, found.y_mm)) == found.depth_mm


def test_before_it_is_started_nothing_presses():
    performance = Performance(load_scenario("step"))
    assert not performance.begun
    assert performance.at(10**12) == (performance.at(0))
    assert not performance.at(0).mirror.dents


def test_two_dents_are_deepest_between_them():
    # two equal Gaussians 1.6 sigma apart add up to one peak in the middle: 2 d exp(-0.8^2 / 2)
    dents = [Dent(Shape.GAUSSIAN, x, 2.0, 0.1, 5.0) for x in (38.0, 46.0)]
    found = deepest(Mirror(tuple(dents)))
    assert found.depth_mm == pytest.approx(0.2 * np.exp(-0.32), rel=1e-6)
    assert (found.x_mm, found.y_mm) == pytest.approx((42.0, 2.0), abs=2e-3)


SILENT = {"camera.noise.read_grey": 0.0, "camera.noise.electrons_per_grey": None}


def test_an_exposure_across_two_pictures_mixes_their_light():
    rig = binned(load_rig("virtual").replace(SILENT), 2)
    size = rig.display.rows, rig.display.columns
    dark, bright = np.zeros(size, np.uint8), np.full(size, 200, np.uint8)
    bender = Bender(rig)

    def grey(pictures: tuple[tuple[NDArray[np.uint8], float], ...]) -> float:
        return float(np.median(bender.image(Exposure(1, 0, 0, pictures), Mirror())))

    black, white, mixed = grey(((dark, 1.0),)), grey(((bright, 1.0),)), grey(((dark, 0.75), (bright, 0.25)))
    # a quarter of the light, not of the grey code; every level is rounded
    assert mixed == pytest.approx(black + 0.25 * (white - black), abs=1.0)
    assert white - black > 50
    bender.close()


def test_pictures_that_do_not_change_are_one():
    a, b = np.zeros((2, 2), np.uint8), np.ones((2, 2), np.uint8)
    found = [(int(picture[0, 0]), share) for picture, share in merged([a, a.copy(), b, a])]
    assert found == [(0, 0.5), (1, 0.25), (0, 0.25)]


class Counting:
    """A monitor whose picture is new with every grab; fails at the tenth."""

    def __init__(self) -> None:
        self._numbers = itertools.count()

    def grab(self) -> NDArray[np.uint8]:
        number = next(self._numbers)
        if number == 10:
            raise RuntimeError("unplugged")
        return np.full((1, 1), number, np.uint8)

    def close(self) -> None:
        pass


def test_exposures_come_at_the_cameras_rate_and_what_fails_is_reported():
    camera = load_rig("virtual").camera.model_copy(update={"rate_hz": 50.0})
    exposer = Exposer(camera, Counting)
    taken: list[Exposure] = []

    def take_all() -> None:
        while True:
            exposure = exposer.take(PATIENCE_S)
            assert exposure is not None
            taken.append(exposure)

    with pytest.raises(RuntimeError, match="unplugged"):
        take_all()
    exposer.close()
    assert len(taken) == 2
    first, second = taken
    # on the grid of 20 ms, whichever of its frames a busy machine lets through
    assert second.time_ns - first.time_ns == 20_000_000 * (second.number - first.number)
    assert first.end_ns - first.time_ns == 4_000_000
    assert [share for _, share in first.pictures] == [0.25] * 4


SIZE = (1280, 800)

DRAW = """
import sys, time
import numpy as np
from zeromethod.drivers.window import WindowDisplay
codes = np.load(sys.argv[1])
display = WindowDisplay(codes.shape[1], codes.shape[0], 60.0, monitor=1)
for _ in range(4):
    display.show(codes)
print("shown", flush=True)
sys.stdin.read()
display.close()
"""


@pytest.fixture(scope="module")
def desktop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[two_monitors.TwoMonitors]:
    with two_monitors.start(tmp_path_factory.mktemp("desktop"), ((640, 480), SIZE)) as started:
        yield started


def virtual_bench(environment: dict[str, str], arguments: Sequence[str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "zeromethod", "virtual-bench", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env=environment, text=True, **pipes)


def port_of(bench: subprocess.Popen[str]) -> int:
    """Port in what the bench prints once it serves."""
    assert bench.stdout is not None
    for line in bench.stdout:
        if "tcp://127.0.0.1:" in line:
            return int(line.rsplit(":", 1)[1])
    raise AssertionError(bench.stderr.read() if bench.stderr else "")


def picture(shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Waves, brighter to the right, so that a shift, a turn or a mirror image would show."""
    row, col = np.mgrid[0 : shape[0], 0 : shape[1]]
    waves = np.cos(2 * np.pi * col / 21) + np.cos(2 * np.pi * row / 17)
    return np.rint(60 + 25 * waves + 60 * col / shape[1] + 20 * row / shape[0]).astype(np.uint8)


def test_a_monitors_picture_comes_back_bent_and_the_bench_ends_when_asked(desktop, tmp_path):
    file = tmp_path / "silent.toml"
    save_values(resource("calibration", "rigs", "virtual.toml"), SILENT, file)
    rig = load_rig(file)
    press = tmp_path / "held.toml"
    press.write_text(
        '[[press]]\nshape = "gaussian"\nsigma_mm = 5.0\n'
        "path = [{ time_s = 0.0, x_mm = 42.0, y_mm = 1.0, depth_mm = 0.2 }]\n"
        '[[phase]]\nname = "hold"\nfrom_s = 0.0\nto_s = 100.0\n'
    )
    codes = picture((rig.display.rows, rig.display.columns))
    np.save(tmp_path / "codes.npy", codes)
    truth = tmp_path / "truth.jsonl"
    arguments = ["--rig", str(file), "--scenario", str(press), "--port", "0", "--truth", str(truth)]
    with subprocess.Popen(
        [sys.executable, "-c", DRAW, str(tmp_path / "codes.npy")],
        env=desktop.environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as drawn:
        bench = virtual_bench(desktop.environment, arguments)
        try:
            assert drawn.stdout is not None
            assert drawn.stdout.readline() == "shown\n"
            with client_of(port_of(bench)) as client:
                assert received_line(client) == b"YUV4MPEG2 W640 H512 F12:1 Ip A1:1 Cmono\n"
                for _ in range(3):
                    image = received_frame(client)
                bench.terminate()
                started = time.monotonic()
                assert bench.wait(PATIENCE_S) == 0
                assert time.monotonic() - started < SOON_S
        finally:
            bench.kill()
            bench.communicate()
            drawn.communicate()
    mirror = Mirror((Dent(Shape.GAUSSIAN, 42.0, 1.0, 0.2, 5.0),))
    reference = NumpyRenderer(rig)
    rows = np.ones(rig.display.rows, np.float32)
    light = reference.expose([Piece(1.0, mirror, [(reference.upload(codes), rows)])])
    expected = Sensor(rig).image(light, 0)
    # positions and light of the shaders are right to some 0.05 grey levels here: only rounding may differ
    difference = np.abs(image.astype(int) - expected.astype(int))
    assert difference.max() <= 1
    assert np.mean(difference) < 0.02
    lines = truth_lines(truth)
    assert lines[0]["rig"] == "virtual"
    # the scenario begins when the client is noticed: an exposure already begun may be of before
    assert {line["phase"] for line in lines[2:]} == {"hold"}
    assert all(line["peak_depth_mm"] == pytest.approx(0.2) for line in lines[2:])
    assert all(0 < time.monotonic_ns() - line["time_ns"] < 60e9 for line in lines[1:])


@pytest.fixture
def fresh_glfw() -> Iterator[None]:
    """It keeps the desktop that it first found, and must let go of it before that ends."""
    import glfw

    glfw.terminate()
    yield
    glfw.terminate()


@pytest.mark.usefixtures("fresh_glfw")
@pytest.mark.parametrize(
    ("options", "display", "said"),
    [
        ("--monitor 2", {}, "--monitor: 2: allowed: 0 (DUMMY0, 640 x 480"),
        ("--monitor 0", {}, "--monitor: 0: set to 640 x 480; the rig's display is 1280 x 800 px"),
        ("--monitor 1", {"DISPLAY": ""}, "no screen: DISPLAY is not set"),
        ("--port {}", {}, "--port: {}: "),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(desktop, monkeypatch, options, display, said):
    for name, value in (desktop.variables | display).items():
        monkeypatch.setenv(name, value)
    with serving() as server:
        code, _, err = run("virtual-bench", options.format(server.port))
    assert (code, err.count("\n")) == (2, 1), err
    assert err.startswith("zeromethod: ")
    assert said.format(server.port) in err
    assert ("port" not in options) or err.endswith("in use\n")


def test_without_mss_the_extra_is_named(monkeypatch):
    from zeromethod.simulation.virtual_bench import grab

    monkeypatch.setattr(grab, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install 'zeromethod\[virtual\]'"):
        grab.find_monitor(0, SIZE)


def test_no_thread_is_left_behind():
    before = set(threading.enumerate())
    with serving() as server:
        server.close()
    assert set(threading.enumerate()) <= before
