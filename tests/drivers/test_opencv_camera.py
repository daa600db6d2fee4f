"""Streams, files and local cameras through OpenCV, from servers of the test's own with known frames."""

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hanging import SOON_S, eventually, takes
from numpy.typing import NDArray

from zeromethod.devices.protocols import CameraLost, CameraTimeout
from zeromethod.drivers.opencv_camera import OpenCVCamera
from zeromethod.errors import InputError

COLUMNS, ROWS = 160, 128
BUSY_S = 60.0
"""More than any frame takes on a busy machine."""


def frames(bits: int, count: int, seed: int = 0) -> list[NDArray[Any]]:
    """Frames of noise over all grey levels, no two alike."""
    dtype = np.uint8 if bits == 8 else np.uint16
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 2**bits, (ROWS, COLUMNS), dtype=dtype) for _ in range(count)]


class StreamServer:
    """y4m over TCP, one frame at a time as the test sends it. The decoder keeps the first to itself."""

    def __init__(self, bits: int = 8, port: int = 0) -> None:
        self.bits = bits
        self._socket = socket.create_server(("127.0.0.1", port))
        self.port: int = self._socket.getsockname()[1]
        self.url = f"tcp://127.0.0.1:{self.port}"
        self._client: socket.socket | None = None
        self._ready = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        try:
            client, _ = self._socket.accept()
        except OSError:
            return
        kind = "mono" if self.bits == 8 else "mono16"
        client.sendall(f"YUV4MPEG2 W{COLUMNS} H{ROWS} F60:1 Ip A1:1 C{kind}\n".encode())
        self._client = client
        for image in frames(self.bits, 2, seed=99):
            self.send(image)
        self._ready.set()

    def send(self, image: NDArray[Any]) -> None:
        self._client.sendall(b"FRAME\n" + image.tobytes())

    def hang_up(self) -> None:
        self._socket.close()
        if self._client is not None and self._ready.wait(BUSY_S):
            self._client.shutdown(socket.SHUT_RDWR)
            self._client.close()
            self._client = None


@pytest.fixture
def serve() -> Iterator[Callable[..., StreamServer]]:
    servers = []

    def start(bits: int = 8, port: int = 0) -> StreamServer:
        servers.append(StreamServer(bits, port))
        return servers[-1]

    yield start
    for server in servers:
        server.hang_up()


Streamed = Callable[..., tuple[StreamServer, OpenCVCamera]]


@pytest.fixture
def streamed(serve: Any, open_camera: Any) -> Streamed:
    """A server and its camera, after the one frame that comes of those that the server sends on its own."""

    def opened(bits: int = 8, port: int = 0, **options: Any) -> tuple[StreamServer, OpenCVCamera]:
        server = serve(bits, port)
        camera = open_camera(server.url, bits=bits, **options)
        camera.first = camera.read(BUSY_S)
        return server, camera

    return opened


def assert_sent_arrives(server: StreamServer, camera: OpenCVCamera, count: int = 1) -> None:
    for sent in frames(server.bits, count):
        server.send(sent)
        received = camera.read(BUSY_S)
        assert received.image.dtype == sent.dtype
        np.testing.assert_array_equal(received.image, sent)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_streamed_grey_levels_arrive_bit_for_bit(streamed, bits):
    server, camera = streamed(bits)
    assert (camera.shape, camera.bits) == ((ROWS, COLUMNS), bits)
    assert_sent_arrives(server, camera, 5)


def test_a_slow_reader_gets_the_newest_frame_and_the_count_of_the_others(streamed):
    server, camera = streamed()
    sent, counted = frames(8, 10), camera._counted
    for image in sent:
        server.send(image)
    answers = camera._worker._answers
    eventually(lambda: answers and answers[-1][1] == counted + 10)
    received = camera.read(BUSY_S)
    np.testing.assert_array_equal(received.image, sent[-1])
    assert (received.dropped, received.number) == (9, camera.first.number + 10)


def test_the_middle_of_the_exposure_follows_from_the_receipt(streamed):
    server, camera = streamed(exposure_s=0.010, latency_s=0.020)
    for image in frames(8, 3):
        before_ns = time.monotonic_ns()
        server.send(image)
        frame = camera.read(BUSY_S)
        assert before_ns <= frame.time_ns + 25_000_000 <= time.monotonic_ns()
        assert frame.exposure_ns == 10_000_000


def test_a_stream_that_stalls_times_out_and_goes_on_unharmed(streamed):
    server, camera = streamed()
    for _ in range(3):
        with takes(0, SOON_S), pytest.raises(CameraTimeout, match=r"^no frame within 0\.2 s$"):
            camera.read(0.2)
    assert_sent_arrives(server, camera)


def test_a_stream_that_stays_silent_is_lost(streamed):
    _, camera = streamed(lost_after_s=1.2)
    with pytest.raises(CameraLost, match="silent for 1 s"):
        camera.read(BUSY_S)


@pytest.mark.parametrize("half_a_frame", [False, True])
def test_a_connection_that_ends_is_a_lost_camera_and_can_be_opened_again(streamed, half_a_frame):
    server, camera = streamed()
    if half_a_frame:  # it is never shown
        server._client.sendall(b"FRAME\n" + frames(8, 1)[0].tobytes()[: COLUMNS * ROWS // 2])  # type: ignore[union-attr]
    server.hang_up()
    with pytest.raises(CameraLost, match=rf"^{server.url}: it has ended$"):
        camera.read(BUSY_S)
    camera.close()
    assert_sent_arrives(*streamed(port=server.port))


ENDING = """
import sys
from zeromethod.drivers.opencv_camera import OpenCVCamera
camera = OpenCVCamera(160, 128, 8, 60.0, 0.004, sys.argv[1])
camera.read(60)
"""


def test_a_silent_stream_does_not_keep_the_program_from_ending(serve):
    command = [sys.executable, "-c", ENDING, serve().url]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (run.stdout, run.stderr) == ("", "")


def test_a_region_is_cut_out(streamed):
    server, camera = streamed(16, columns=96, rows=64, region_px=(10, 20, 96, 64))
    assert camera.shape == (64, 96)
    (sent,) = frames(16, 1)
    server.send(sent)
    np.testing.assert_array_equal(camera.read(BUSY_S).image, sent[20:84, 10:106])


@pytest.mark.parametrize(
    ("bits", "options", "message"),
    [
        (8, {"region_px": (100, 0, 96, 64)}, r"^camera\.region_px: \[100, 0, 96, 64\]: the frames are 160 x"),
        (16, {"bits": 12}, r"^camera\.bits: 12: the frames reach \d+: 16 bits$"),
        (8, {"gain": 2.0}, r"^camera\.gain: 2\.0: a stream or file has none$"),
        (8, {"pixel_format": "Mono8"}, r"^camera\.pixel_format: 'Mono8': a stream or file has none$"),
        (8, {"trigger": "software"}, r'^camera\.trigger: "software": allowed: "free"'),
    ],
)
def test_settings_that_a_stream_does_not_have_are_refused(serve, open_camera, bits, options, message):
    with pytest.raises(InputError, match=message):
        open_camera(serve(bits).url, **options)


def test_a_stream_that_is_not_there_is_refused_without_its_password(open_camera, capfd):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(InputError, match="cannot be opened") as error:
        open_camera(f"http://me:secret@127.0.0.1:{port}/video")
    assert "secret" not in str(error.value)
    assert f"127.0.0.1 refuses connections at port {port}" in str(error.value)
    assert capfd.readouterr().err == ""


def test_a_server_that_never_speaks_is_given_up(open_camera):
    mute = socket.create_server(("127.0.0.1", 0))
    with mute, takes(0, SOON_S), pytest.raises((InputError, CameraLost)):
        open_camera(f"tcp://127.0.0.1:{mute.getsockname()[1]}", open_timeout_s=0.5)


def smooth_picture() -> NDArray[Any]:
    return cv2.GaussianBlur(frames(8, 1)[0], (0, 0), 4)


@pytest.fixture
def http_url() -> Iterator[str]:
    """MJPEG over HTTP, always the same smooth picture."""
    data = cv2.imencode(".jpg", smooth_picture(), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    part = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(data), data)

    def serve() -> None:
        with contextlib.suppress(OSError), server.accept()[0] as client:
            client.recv(4096)
            kind = b"Content-Type: multipart/x-mixed-replace; boundary=frame"
            client.sendall(b"HTTP/1.0 200 OK\r\n" + kind + b"\r\n\r\n")
            for _ in range(200):
                client.sendall(part)
                time.sleep(0.03)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}/"


def test_compressed_pictures_over_http_are_grey_within_what_jpeg_loses(http_url, open_camera):
    camera = open_camera(http_url + "video")
    for _ in range(3):
        frame = camera.read(BUSY_S)
        # quality 95 quantises these smooth pictures to a fraction of a grey level
        assert np.abs(frame.image.astype(float) - smooth_picture()).mean() < 1.0


def film(path: Path, images: list[NDArray[Any]], rate_hz: int) -> Path:
    kind = "mono" if images[0].dtype == np.uint8 else "mono16"
    head = f"YUV4MPEG2 W{COLUMNS} H{ROWS} F{rate_hz}:1 Ip A1:1 C{kind}\n".encode()
    path.write_bytes(head + b"".join(b"FRAME\n" + image.tobytes() for image in images))
    return path


def test_a_file_plays_at_its_own_rate_and_is_lost_at_its_end(tmp_path, open_camera):
    images = frames(16, 6)
    camera = open_camera(str(film(tmp_path / "film.y4m", images, 5)), bits=16)
    received = [camera.read(BUSY_S) for _ in images]
    for frame, image in zip(received, images, strict=True):
        np.testing.assert_array_equal(frame.image, image)
    np.testing.assert_allclose(np.diff([frame.time_ns for frame in received]), 2e8, atol=2)  # whole ns
    with pytest.raises(CameraLost, match="end of file"):
        camera.read(BUSY_S)


def test_a_file_that_plays_on_is_skipped_like_a_camera(tmp_path, open_camera):
    images = frames(8, 40)
    camera = open_camera(str(film(tmp_path / "film.y4m", images, 50)))
    camera.read(BUSY_S)
    time.sleep(0.3)
    frame = camera.read(BUSY_S)
    assert frame.number == 1 + frame.dropped
    assert frame.dropped > 5  # 15 frames in 0.3 s, fewer only if the thread came late
    np.testing.assert_array_equal(frame.image, images[frame.number])


@pytest.mark.parametrize("name", ["missing.mp4", "text.mp4"])
def test_a_file_that_is_no_film_is_refused(tmp_path, open_camera, name):
    (tmp_path / "text.mp4").write_text("no film")
    with pytest.raises(InputError, match=r"^camera\.source: .*(no such file|cannot be opened)"):
        open_camera(str(tmp_path / name))
