"""GigE Vision, with Aravis' fake camera in a process of its own on the loopback interface."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fake_gige_camera import ADDRESS, FakeGigECamera

from zeromethod.devices.protocols import CameraLost, CameraTimeout
from zeromethod.drivers import aravis_library
from zeromethod.drivers.aravis_camera import AravisCamera
from zeromethod.drivers.aravis_library import LIBRARY
from zeromethod.drivers.listing import Found, cameras
from zeromethod.errors import InputError

try:
    ctypes.CDLL(LIBRARY)
except OSError:
    pytest.skip(f"{LIBRARY} is not installed", allow_module_level=True)

COLUMNS, ROWS = 320, 256
BUSY_S = 5.0
CONTROL_LOST_S = 15.0
"""Aravis gives a silent camera five seconds; three times that on a busy machine."""

Open = Callable[..., AravisCamera]


@pytest.fixture(scope="module")
def shared() -> Iterator[FakeGigECamera]:
    fake = FakeGigECamera()
    fake.start()
    yield fake
    fake.kill()


@pytest.fixture
def open_camera(shared: FakeGigECamera) -> Iterator[Open]:
    opened = []

    def open_it(**options: Any) -> AravisCamera:
        settings = {"columns": COLUMNS, "rows": ROWS, "bits": 8, "rate_hz": 50.0, "exposure_s": 0.004}
        opened.append(AravisCamera(**(settings | {"address": ADDRESS} | options)))
        return opened[-1]

    yield open_it
    for camera in opened:
        camera.close()


def read_on(camera: AravisCamera) -> None:
    """Read until something is raised; at most a few frames are still on their way."""
    for _ in range(20):
        camera.read(0.5)


def known(bits: int) -> np.ndarray:
    image = (np.arange(ROWS)[:, None] + 2 * np.arange(COLUMNS)) % 251
    return image.astype(np.uint8) if bits == 8 else (257 * image).astype(np.uint16)


@pytest.mark.parametrize("bits", [8, 16])
def test_grey_levels_arrive_bit_for_bit(open_camera: Open, bits: int) -> None:
    camera = open_camera(bits=bits)
    assert (camera.shape, camera.bits) == ((ROWS, COLUMNS), bits)
    for _ in range(3):
        frame = camera.read(BUSY_S)
        assert frame.image.dtype == known(bits).dtype
        np.testing.assert_array_equal(frame.image, known(bits))


def test_a_slow_reader_gets_the_newest_frame_and_the_count_of_the_others(open_camera: Open) -> None:
    camera = open_camera()
    first = camera.read(BUSY_S)
    time.sleep(0.5)
    later = camera.read(BUSY_S)
    assert later.number - first.number == 1 + later.dropped
    assert 10 < later.dropped < 60  # 25 of 20 ms each, fewer or more on a busy machine


def test_device_stamps_become_times_of_the_host(open_camera: Open) -> None:
    camera = open_camera(exposure_s=0.004, latency_s=0.003)
    frames = [camera.read(BUSY_S) for _ in range(20)]
    assert 0 < time.monotonic_ns() - frames[-1].time_ns - 5_000_000 < 1e9
    # its stamps are the fake's own clock, 20 ms apart; a busy machine makes it sleep longer, never less
    steps = [(b.time_ns - a.time_ns) / (b.number - a.number) for a, b in pairwise(frames)]
    assert 19e6 < np.median(steps) < 30e6


def test_a_software_trigger_takes_one_frame_for_each_read(open_camera: Open) -> None:
    camera = open_camera(trigger="software")
    for number in range(3):
        time.sleep(0.15)
        asked_ns = time.monotonic_ns()
        frame = camera.read(BUSY_S)
        assert frame.number == number
        if number == 0:  # the clocks' map begins with the first frame's receipt
            assert frame.time_ns > asked_ns - 2_000_000


def test_a_camera_that_waits_for_its_trigger_times_out(open_camera: Open) -> None:
    camera = open_camera(trigger="hardware", trigger_source="Line0")
    with pytest.raises(CameraTimeout):
        camera.read(0.3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"address": "nobody"}, r"^camera\.address: 'nobody': cannot be opened: "),
        ({"gain": 1e6}, r"^camera\.gain: 1000000\.0: the device allows GainRaw from 0 to 10$"),
        ({"exposure_s": 100.0}, r"^camera\.exposure_s: 100\.0: the device allows ExposureTimeAbs from 1e-05"),
        ({"bits": 12}, r'^camera\.pixel_format: "Mono12": the device allows "Mono8", "Mono16"$'),
        (
            {"region_px": (9000, 0, COLUMNS, ROWS)},
            r"^camera\.region_px: 9000: the device allows OffsetX from 0",
        ),
        (
            {"trigger": "hardware", "trigger_source": "Line9"},
            r'^camera\.trigger_source: "Line9": the device allows "Line0", "Software"$',
        ),
        ({"rate_hz": 9000.0}, r"^camera\.rate_hz: 9000\.0: the device allows AcquisitionFrameRate from"),
        ({"features": {"Nix": 3}}, r"^camera\.features\.Nix: 3: the device has no Nix$"),
    ],
)
def test_what_the_device_refuses_is_told_in_one_line(
    open_camera: Open, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as error:
        open_camera(**options)
    assert "\n" not in str(error.value)


def test_it_is_listed_as_the_command_takes_it_and_the_first_is_found(open_camera: Open) -> None:
    assert Found("aravis:127.0.0.1", "Aravis-Fake-GV01") in cameras().cameras
    assert open_camera(address="").read(BUSY_S).image.shape == (ROWS, COLUMNS)


def test_without_the_library_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, open_camera: Open
) -> None:
    monkeypatch.setattr(aravis_library, "LIBRARY", "libnothing.so")
    aravis_library.library.cache_clear()
    with pytest.raises(InputError, match=r"^camera\.driver: 'aravis': needs .*apt install libaravis-0\.8-0"):
        open_camera()
    aravis_library.library.cache_clear()


def test_a_camera_that_goes_is_lost_and_can_be_opened_again(
    shared: FakeGigECamera, open_camera: Open
) -> None:
    camera = open_camera()
    camera.read(BUSY_S)
    shared.kill()
    start = time.monotonic()
    with pytest.raises(CameraTimeout):
        read_on(camera)
    with pytest.raises(CameraLost, match="control lost"):
        camera.read(CONTROL_LOST_S)
    assert time.monotonic() - start < CONTROL_LOST_S
    start = time.monotonic()
    camera.close()
    assert time.monotonic() - start < 1.0
    shared.start()
    np.testing.assert_array_equal(open_camera().read(BUSY_S).image, known(8))
