"""The exposure of a camera that is grabbed is changed in the thread that grabs it."""

import threading
import time

import numpy as np
import pytest

from zeromethod.devices.abilities import exposure_setter_of
from zeromethod.devices.protocols import Frame
from zeromethod.drivers.device_clock import MidExposure
from zeromethod.drivers.genicam import set_exposure
from zeromethod.drivers.grabbing import GrabbedCamera
from zeromethod.errors import InputError


class Fixed:
    """A source without a settable exposure."""

    shape, bits, on_demand = (4, 5), 8, False

    def __init__(self) -> None:
        self.times = MidExposure(0.01, 0.0)
        self.number = -1

    def grab(self) -> Frame:
        time.sleep(0.002)
        self.number += 1
        now_ns = time.monotonic_ns()
        image = np.zeros(self.shape, np.uint8)
        return Frame(image, self.times.of(now_ns), self.times.exposure_ns, self.number)

    def close(self) -> None: ...


class Settable(Fixed):
    thread: threading.Thread | None = None

    def set_exposure(self, exposure_s: float) -> float:
        if exposure_s > 1:
            raise InputError("camera.exposure_s: 2: the device allows up to 1")
        self.thread = threading.current_thread()
        taken_s = round(exposure_s, 3)
        self.times.set_exposure(taken_s)
        return taken_s


def test_a_new_exposure_holds_for_later_frames_and_is_set_where_frames_are_grabbed():
    source = Settable()
    camera = GrabbedCamera("test", lambda: source, 5.0)
    try:
        assert camera.read(5.0).exposure_ns == 10_000_000
        setter = exposure_setter_of(camera)
        assert setter is not None
        assert setter(0.0204) == 0.02
        assert source.thread is not threading.current_thread()
        camera.read(5.0)
        assert camera.read(5.0).exposure_ns == 20_000_000
        with pytest.raises(InputError, match="the device allows up to 1"):
            setter(2.0)
        assert camera.read(5.0).exposure_ns == 20_000_000  # it goes on
    finally:
        camera.close()


def test_a_camera_that_cannot_change_it_says_so():
    camera = GrabbedCamera("test", Fixed, 5.0)
    try:
        assert exposure_setter_of(camera) is None
        assert exposure_setter_of(object()) is None
    finally:
        camera.close()


def test_the_middle_of_an_exposure_follows_its_length():
    times = MidExposure(0.010, 0.001)
    assert times.of(1_000_000_000) == 1_000_000_000 - 6_000_000
    times.set_exposure(0.020)
    assert times.of(2_000_000_000) == 2_000_000_000 - 11_000_000


class Features:
    """A device whose exposure goes in steps of 10 us up to 1 s."""

    value_us = 0.0

    def available(self, name: str) -> bool:
        return name == "ExposureTimeAbs"

    def get(self, name: str) -> float:
        return self.value_us

    def put(self, name: str, value: float) -> None:
        self.value_us = 10 * round(value / 10)

    def bounds(self, name: str) -> tuple[float, float]:
        return 10.0, 1e6

    def choices(self, name: str) -> tuple[str, ...]:
        return ()


def test_a_genicam_exposure_is_what_the_device_made_of_it():
    features = Features()
    assert set_exposure(features, 0.012344) == pytest.approx(0.01234)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"camera\.exposure_s: 2\.0: the device allows ExposureTimeAbs from"):
        set_exposure(features, 2.0)  # type: ignore[arg-type]
