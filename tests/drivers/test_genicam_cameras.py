"""GenICam cameras of every library: pylon's own emulator, and Aravis' fake camera in a process of its own.

The emulator is fed with known pictures from a folder; the fake camera makes them of row and column.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from fake_gige_camera import ADDRESS, FakeGigECamera
from hanging import SOON_S, raising, takes
from numpy.typing import NDArray

os.environ["PYLON_CAMEMU"] = "2"  # read when pypylon first looks for cameras

from zeromethod.devices.protocols import CameraLost, CameraTimeout
from zeromethod.drivers import aravis_library, pylon_camera
from zeromethod.drivers.aravis_camera import AravisCamera
from zeromethod.drivers.grabbing import GrabbedCamera
from zeromethod.drivers.listing import Found, cameras
from zeromethod.drivers.pylon_camera import PylonCamera
from zeromethod.errors import InputError

COLUMNS, ROWS = 320, 256
SHAPE = ROWS, COLUMNS
SERIALS = ["0815-0000", "0815-0001"]
BUSY_S = 60.0
CONTROL_LOST_S = 60.0
"""Aravis gives a silent camera five seconds; a busy machine is late."""

Open = Callable[..., GrabbedCamera]


def opener(kind: type, **fixed: Any) -> Iterator[Open]:
    """Opens cameras of a kind, and closes them at the end."""
    opened: list[GrabbedCamera] = []

    def open_it(**options: Any) -> GrabbedCamera:
        settings = {"columns": COLUMNS, "rows": ROWS, "bits": 8, "rate_hz": 50.0, "exposure_s": 0.004}
        opened.append(kind(**(settings | fixed | options)))
        return opened[-1]

    yield open_it
    for camera in opened:
        camera.close()


@pytest.fixture
def emulated(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The emulated devices of pylon, as they are opened."""
    pylon = pytest.importorskip("pypylon.pylon")
    opened: list[Any] = []
    instant = pylon.InstantCamera

    def create(device: Any) -> Any:
        opened.append(instant(device))
        return opened[-1]

    monkeypatch.setattr(pylon, "InstantCamera", create)
    return opened


@pytest.fixture(scope="module")
def fake() -> Iterator[FakeGigECamera]:
    try:
        ctypes.CDLL(aravis_library.LIBRARY)
    except OSError:
        pytest.skip(f"{aravis_library.LIBRARY} is not installed")
    camera = FakeGigECamera()
    camera.start()
    yield camera
    camera.kill()


@pytest.fixture
def pylon(emulated: list[Any]) -> Iterator[Open]:
    yield from opener(PylonCamera)


@pytest.fixture
def aravis(fake: FakeGigECamera) -> Iterator[Open]:
    yield from opener(AravisCamera, address=ADDRESS)


@pytest.fixture(params=["pylon", "aravis"])
def either(request: pytest.FixtureRequest) -> Open:
    made: Open = request.getfixturevalue(request.param)
    return made


def read_on(camera: GrabbedCamera, timeout_s: float) -> None:
    """Read until something is raised; at most a few frames are still on their way."""
    for _ in range(20):
        camera.read(timeout_s)


def film(folder: Path, bits: int) -> tuple[dict[str, Any], NDArray[Any]]:
    """Settings that make the emulator show a folder's pictures, and the one picture in it."""
    dtype = np.uint8 if bits == 8 else np.uint16
    picture = np.random.default_rng(bits).integers(0, 2**bits, SHAPE, dtype=dtype)
    # the emulator takes a file's levels for 16 bits and shifts them down
    for name in ("a.png", "b.png"):  # a single one would be kept in memory
        cv2.imwrite(str(folder / name), picture << (16 - bits) if bits > 8 else picture)
    return {"TestImageSelector": "Off", "ImageFilename": str(folder), "ImageFileMode": "On"}, picture


def by_place(bits: int) -> NDArray[Any]:
    """The picture of the fake camera."""
    image = (np.arange(ROWS)[:, None] + 2 * np.arange(COLUMNS)) % 251
    return image.astype(np.uint8) if bits == 8 else (257 * image).astype(np.uint16)


def assert_shows(camera: GrabbedCamera, picture: NDArray[Any], bits: int) -> None:
    assert (camera.shape, camera.bits) == (SHAPE, bits)
    for _ in range(3):
        frame = camera.read(BUSY_S)
        assert frame.image.dtype == picture.dtype
        np.testing.assert_array_equal(frame.image, picture)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_grey_levels_of_the_emulator_arrive_bit_for_bit(tmp_path: Path, pylon: Open, bits: int) -> None:
    features, picture = film(tmp_path, bits)
    assert_shows(pylon(bits=bits, features=features), picture, bits)


@pytest.mark.parametrize("bits", [8, 16])
def test_grey_levels_of_the_fake_camera_arrive_bit_for_bit(aravis: Open, bits: int) -> None:
    assert_shows(aravis(bits=bits), by_place(bits), bits)


def test_the_device_has_what_the_rig_asks_for(pylon: Open, emulated: list[Any]) -> None:
    pylon(region_px=(16, 32, COLUMNS, ROWS), gain=6.0, exposure_s=0.003, rate_hz=40.0, bits=12)
    nodes = emulated[0].GetNodeMap()
    names = ("OffsetX", "OffsetY", "Width", "Height", "PixelFormat", "TriggerMode")
    assert [nodes.GetNode(name).GetValue() for name in names] == [16, 32, COLUMNS, ROWS, "Mono12", "Off"]
    assert nodes.GetNode("ExposureTime").GetValue() == pytest.approx(3000)
    assert nodes.GetNode("AcquisitionFrameRate").GetValue() == pytest.approx(40)
    assert nodes.GetNode("Gain").GetValue() == pytest.approx(6, abs=0.1)  # of steps of 0.06


def test_frames_are_stamped_on_receipt_where_the_device_stamps_none(pylon: Open) -> None:
    camera = pylon(exposure_s=0.004, latency_s=0.003)
    for _ in range(3):
        frame = camera.read(BUSY_S)
        assert frame.exposure_ns == 4_000_000
        assert 5_000_000 <= time.monotonic_ns() - frame.time_ns < 5_000_000 + 1e9 * SOON_S


def test_device_stamps_become_times_of_the_host(aravis: Open) -> None:
    camera = aravis(exposure_s=0.004, latency_s=0.003)
    frames = [camera.read(BUSY_S) for _ in range(20)]
    assert 0 < time.monotonic_ns() - frames[-1].time_ns - 5_000_000 < 1e9 * SOON_S
    # its stamps are the fake's own clock, 20 ms apart; a busy machine makes it sleep longer, never less
    steps = [(b.time_ns - a.time_ns) / (b.number - a.number) for a, b in pairwise(frames)]
    assert 19e6 < np.median(steps) < 1e9


def test_a_software_trigger_takes_one_frame_for_each_read(either: Open) -> None:
    camera = either(trigger="software")
    for number in range(3):
        time.sleep(0.2)
        asked_ns = time.monotonic_ns()
        frame = camera.read(BUSY_S)
        assert frame.number == number
        # half an exposure: it was not lit before. The map of a device's clock begins with the first receipt.
        assert frame.time_ns > asked_ns - 2_000_000 or (isinstance(camera, AravisCamera) and number)


def test_a_camera_that_waits_for_its_trigger_times_out(aravis: Open) -> None:
    camera = aravis(trigger="hardware", trigger_source="Line0")
    with pytest.raises(CameraTimeout):
        camera.read(0.3)


def test_frames_that_came_broken_count_as_dropped(pylon: Open, emulated: list[Any]) -> None:
    camera = pylon(trigger="software")
    camera.read(BUSY_S)
    nodes = emulated[0].GetNodeMap()
    nodes.GetNode("ForceFailedBufferCount").SetValue(1)
    nodes.GetNode("ForceFailedBuffer").Execute()
    assert camera.read(BUSY_S).dropped == 1


def test_a_removed_camera_is_lost_and_can_be_opened_again(pylon: Open, emulated: list[Any]) -> None:
    camera = pylon(serial=SERIALS[1])
    camera.read(BUSY_S)
    emulated[0].GetNodeMap().GetNode("FirePnPCallback").Execute()
    with pytest.raises(CameraLost, match=r"^the camera was removed$"):
        read_on(camera, BUSY_S)
    with takes(0, SOON_S):
        camera.close()
    assert pylon(serial=SERIALS[1]).read(BUSY_S).image.shape == SHAPE


def test_a_camera_that_goes_silent_is_lost_and_can_be_opened_again(fake, aravis):
    camera = aravis()
    camera.read(BUSY_S)
    fake.kill()
    with takes(0, CONTROL_LOST_S):
        with pytest.raises(CameraTimeout):
            read_on(camera, 0.5)
        with pytest.raises(CameraLost, match="control lost"):
            camera.read(CONTROL_LOST_S)
    with takes(0, SOON_S):
        camera.close()
    fake.start()
    np.testing.assert_array_equal(aravis().read(BUSY_S).image, by_place(8))


FAR = {"region_px": (9000, 0, COLUMNS, ROWS)}
LINE9 = {"trigger": "hardware", "trigger_source": "Line9"}
REFUSED: dict[str, list[tuple[dict[str, Any], str]]] = {
    "pylon": [
        ({"serial": "X"}, rf"serial: 'X': allowed: {', '.join(SERIALS)}$"),
        ({"gain": 100.0}, r"gain: 100\.0: the device allows Gain from 0 to 48"),
        ({"exposure_s": 100.0}, r"exposure_s: 100\.0: the device allows \w+ from 1e-06 to 10$"),
        ({"pixel_format": "BayerGR8"}, r'pixel_format: "BayerGR8": the device allows "Mono8", '),
        ({"pixel_format": "Mono12"}, r'pixel_format: "Mono12": has 12 bits; camera\.bits is 8$'),
        ({"bits": 14}, r'pixel_format: "Mono14": the device allows "Mono8", '),
        ({"columns": 9000}, r"columns: 9000: the device allows Width from 1 to 4096$"),
        (FAR, r"region_px: 9000: the device allows OffsetX from 0"),
        (LINE9, r'trigger_source: "Line9": the device allows "Software", "Line1", '),
        ({"rate_hz": 9000.0}, r"rate_hz: 9000\.0: the device allows AcquisitionFrameRate from"),
        ({"features": {"Nix": 3}}, r"features\.Nix: 3: the device has no Nix$"),
    ],
    "aravis": [
        ({"address": "nobody"}, r"address: 'nobody': cannot be opened: "),
        ({"gain": 1e6}, r"gain: 1000000\.0: the device allows GainRaw from 0 to 10$"),
        ({"exposure_s": 100.0}, r"exposure_s: 100\.0: the device allows ExposureTimeAbs from 1e-05"),
        ({"bits": 12}, r'pixel_format: "Mono12": the device allows "Mono8", "Mono16"$'),
        (FAR, r"region_px: 9000: the device allows OffsetX from 0"),
        (LINE9, r'trigger_source: "Line9": the device allows "Line0", "Software"$'),
        ({"rate_hz": 9000.0}, r"rate_hz: 9000\.0: the device allows AcquisitionFrameRate from"),
        ({"features": {"Nix": 3}}, r"features\.Nix: 3: the device has no Nix$"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "options", "message"), [(kind, *row) for kind, rows in REFUSED.items() for row in rows]
)
def test_values_that_the_device_refuses_are_reported_in_one_line(request, kind, options, message):
    with pytest.raises(InputError, match=rf"^camera\.{message}") as error:
        request.getfixturevalue(kind)(**options)
    assert "\n" not in str(error.value)


def test_cameras_are_listed_as_the_command_takes_them(pylon: Open, aravis: Open) -> None:
    listed = cameras().cameras
    basler = [camera for camera in listed if camera.address.startswith("pylon:")]
    assert basler == [Found(f"pylon:{serial}", f"Basler Emulation ({serial})") for serial in SERIALS]
    assert Found(f"aravis:{ADDRESS}", "Aravis-Fake-GV01") in listed
    assert aravis(address="").read(BUSY_S).image.shape == SHAPE  # the first is found


def test_without_its_library_a_driver_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = COLUMNS, ROWS, 8, 50.0, 0.004
    monkeypatch.setattr(pylon_camera.importlib, "import_module", raising(ImportError("pypylon")))
    with pytest.raises(InputError, match=r"^camera\.driver: 'pylon': .*pip install 'zeromethod\[pylon\]'$"):
        PylonCamera(*settings)
    monkeypatch.setattr(aravis_library, "LIBRARY", "libnothing.so")
    aravis_library.library.cache_clear()
    with pytest.raises(InputError, match=r"^camera\.driver: 'aravis': needs .*apt install libaravis-0\.8-0"):
        AravisCamera(*settings)
    aravis_library.library.cache_clear()


def test_a_basler_camera_that_another_program_has_is_in_use(pylon, monkeypatch):
    library, genicam = pylon_camera.import_pylon()
    taken = Mock()
    taken.Open.side_effect = genicam.RuntimeException("The device is controlled by another application.")
    monkeypatch.setattr(library, "InstantCamera", lambda _: taken)
    with pytest.raises(InputError, match="in use by another program: end that first"):
        pylon()
