"""Basler cameras, on pylon's own emulator of one, which is fed with known pictures from a folder."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

os.environ["PYLON_CAMEMU"] = "2"  # read when pypylon first looks for cameras
pylon = pytest.importorskip("pypylon.pylon")

from zeromethod.devices.protocols import CameraLost  # noqa: E402
from zeromethod.drivers import pylon_camera  # noqa: E402
from zeromethod.drivers.listing import Found, cameras  # noqa: E402
from zeromethod.drivers.pylon_camera import PylonCamera  # noqa: E402
from zeromethod.errors import InputError  # noqa: E402

COLUMNS, ROWS = 320, 256
SERIALS = ["0815-0000", "0815-0001"]
BUSY_S = 5.0

Open = Callable[..., PylonCamera]


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The emulated devices, as they are opened."""
    opened: list[Any] = []
    instant = pylon.InstantCamera

    def create(device: Any) -> Any:
        opened.append(instant(device))
        return opened[-1]

    monkeypatch.setattr(pylon, "InstantCamera", create)
    return opened


@pytest.fixture
def open_camera(devices: list[Any]) -> Iterator[Open]:
    opened = []

    def open_it(**options: Any) -> PylonCamera:
        settings = {"columns": COLUMNS, "rows": ROWS, "bits": 8, "rate_hz": 50.0, "exposure_s": 0.004}
        opened.append(PylonCamera(**(settings | options)))
        return opened[-1]

    yield open_it
    for camera in opened:
        camera.close()


def read_on(camera: PylonCamera) -> None:
    """Read until something is raised; at most a few frames are still on their way."""
    for _ in range(20):
        camera.read(BUSY_S)


def film(folder: Path, bits: int) -> tuple[dict[str, Any], NDArray[Any]]:
    """Settings that make the emulator show a folder's pictures, and the one picture in it."""
    dtype = np.uint8 if bits == 8 else np.uint16
    picture = np.random.default_rng(bits).integers(0, 2**bits, (ROWS, COLUMNS), dtype=dtype)
    # the emulator takes a file's levels for 16 bits and shifts them down
    for name in ("a.png", "b.png"):  # a single one would be kept in memory
        cv2.imwrite(str(folder / name), picture << (16 - bits) if bits > 8 else picture)
    return {"TestImageSelector": "Off", "ImageFilename": str(folder), "ImageFileMode": "On"}, picture


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_grey_levels_arrive_bit_for_bit(tmp_path: Path, open_camera: Open, bits: int) -> None:
    features, picture = film(tmp_path, bits)
    camera = open_camera(bits=bits, features=features)
    assert (camera.shape, camera.bits) == ((ROWS, COLUMNS), bits)
    for _ in range(3):
        frame = camera.read(BUSY_S)
        assert frame.image.dtype == picture.dtype
        np.testing.assert_array_equal(frame.image, picture)


def test_a_slow_reader_gets_the_newest_frame_and_the_count_of_the_others(open_camera: Open) -> None:
    camera = open_camera()
    first = camera.read(BUSY_S)
    time.sleep(0.5)
    later = camera.read(BUSY_S)
    assert later.number - first.number == 1 + later.dropped
    assert 10 < later.dropped < 60  # 25 of 20 ms each, fewer or more on a busy machine
    assert later.time_ns - first.time_ns > 0.4e9


def test_the_device_has_what_the_rig_asks_for(open_camera: Open, devices: list[Any]) -> None:
    open_camera(region_px=(16, 32, COLUMNS, ROWS), gain=6.0, exposure_s=0.003, rate_hz=40.0, bits=12)
    nodes = devices[0].GetNodeMap()
    names = ("OffsetX", "OffsetY", "Width", "Height", "PixelFormat", "TriggerMode")
    assert [nodes.GetNode(name).GetValue() for name in names] == [16, 32, COLUMNS, ROWS, "Mono12", "Off"]
    assert nodes.GetNode("ExposureTime").GetValue() == pytest.approx(3000)
    assert nodes.GetNode("AcquisitionFrameRate").GetValue() == pytest.approx(40)
    assert nodes.GetNode("Gain").GetValue() == pytest.approx(6, abs=0.1)  # of steps of 0.06


def test_frames_are_stamped_on_receipt_where_the_device_stamps_none(open_camera: Open) -> None:
    camera = open_camera(exposure_s=0.004, latency_s=0.003)
    for _ in range(3):
        frame = camera.read(BUSY_S)
        age_ns = time.monotonic_ns() - frame.time_ns
        assert frame.exposure_ns == 4_000_000
        assert 5_000_000 <= age_ns < 5_000_000 + 1e9


def test_a_software_trigger_takes_one_frame_for_each_read(open_camera: Open) -> None:
    camera = open_camera(trigger="software")
    for number in range(3):
        time.sleep(0.2)
        asked_ns = time.monotonic_ns()
        frame = camera.read(BUSY_S)
        assert frame.number == number
        assert frame.time_ns > asked_ns - 2_000_000  # half an exposure: it was not lit before


def test_frames_that_came_broken_count_as_dropped(open_camera: Open, devices: list[Any]) -> None:
    camera = open_camera(trigger="software")
    camera.read(BUSY_S)
    nodes = devices[0].GetNodeMap()
    nodes.GetNode("ForceFailedBufferCount").SetValue(1)
    nodes.GetNode("ForceFailedBuffer").Execute()
    assert camera.read(BUSY_S).dropped == 1


def test_a_removed_camera_is_lost_and_can_be_opened_again(open_camera: Open, devices: list[Any]) -> None:
    camera = open_camera(serial=SERIALS[1])
    camera.read(BUSY_S)
    devices[0].GetNodeMap().GetNode("FirePnPCallback").Execute()
    with pytest.raises(CameraLost, match=r"^the camera was removed$"):
        read_on(camera)
    start = time.monotonic()
    camera.close()
    assert time.monotonic() - start < 1.0
    assert open_camera(serial=SERIALS[1]).read(BUSY_S).image.shape == (ROWS, COLUMNS)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"serial": "X"}, rf"^camera\.serial: 'X': allowed: {', '.join(SERIALS)}$"),
        ({"gain": 100.0}, r"^camera\.gain: 100\.0: the device allows Gain from 0 to 48"),
        ({"exposure_s": 100.0}, r"^camera\.exposure_s: 100\.0: the device allows \w+ from 1e-06 to 10$"),
        ({"pixel_format": "BayerGR8"}, r'^camera\.pixel_format: "BayerGR8": the device allows "Mono8", '),
        ({"pixel_format": "Mono12"}, r'^camera\.pixel_format: "Mono12": has 12 bits; camera\.bits is 8$'),
        ({"bits": 14}, r'^camera\.pixel_format: "Mono14": the device allows "Mono8", '),
        ({"columns": 9000}, r"^camera\.columns: 9000: the device allows Width from 1 to 4096$"),
        (
            {"region_px": (4000, 0, COLUMNS, ROWS)},
            r"^camera\.region_px: 4000: the device allows OffsetX from 0",
        ),
        (
            {"trigger": "hardware", "trigger_source": "Line9"},
            r'^camera\.trigger_source: "Line9": the device allows "Software", "Line1", ',
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


def test_cameras_are_listed_as_the_command_takes_them() -> None:
    listed = [camera for camera in cameras().cameras if camera.address.startswith("pylon:")]
    assert listed == [Found(f"pylon:{serial}", f"Basler Emulation ({serial})") for serial in SERIALS]


def test_without_pypylon_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, open_camera: Open) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(pylon_camera.importlib, "import_module", missing)
    with pytest.raises(InputError, match=r"^camera\.driver: 'pylon': .*pip install 'zeromethod\[pylon\]'$"):
        open_camera()
