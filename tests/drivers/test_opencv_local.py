"""Local cameras through OpenCV, on a stand-in for its capture: no machine without a camera can open one."""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.devices.protocols import CameraLost
from zeromethod.drivers.opencv_camera import OpenCVCamera
from zeromethod.errors import InputError

COLUMNS, ROWS = 160, 128
BUSY_S = 60.0


class LocalCapture:
    """Stands in for OpenCV's capture. Its sixth frame is smaller than those before."""

    taken: dict[int, float]

    def __init__(self, index: int, backend: int, params: list[int]) -> None:
        self.taken = {}
        self.reads = 0
        LocalCapture.last = self

    last: LocalCapture
    least_exposure = 0.0
    formats = ("GREY", "Y16 ")

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def set(self, key: int, value: float) -> bool:
        known = [cv2.VideoWriter.fourcc(*name) for name in self.formats]
        if key == cv2.CAP_PROP_GAIN or (key == cv2.CAP_PROP_FOURCC and value not in known):
            return False
        self.taken[key] = max(value, self.least_exposure) if key == cv2.CAP_PROP_EXPOSURE else value
        return True

    def get(self, key: int) -> float:
        return time.monotonic() * 1e3 if key == cv2.CAP_PROP_POS_MSEC else self.taken.get(key, 0.0)

    def read(self) -> tuple[bool, NDArray[Any]]:
        time.sleep(0.01)
        self.reads += 1
        return True, np.full((ROWS // (1 + (self.reads > 5)), COLUMNS), 1000, np.uint16)

    def release(self) -> None:
        pass


@pytest.fixture
def local(monkeypatch: pytest.MonkeyPatch) -> type[LocalCapture]:
    monkeypatch.setattr(cv2, "VideoCapture", LocalCapture)
    monkeypatch.setattr(LocalCapture, "least_exposure", 0.0)
    return LocalCapture


def test_a_local_camera_is_set_up_by_the_rig(local, open_camera):
    camera = open_camera(0, bits=12, pixel_format="Mono16", exposure_s=0.004)
    assert camera.bits == 12
    taken = local.last.taken
    assert taken[cv2.CAP_PROP_EXPOSURE] == 40  # of 100 us
    assert (taken[cv2.CAP_PROP_FRAME_WIDTH], taken[cv2.CAP_PROP_FRAME_HEIGHT]) == (COLUMNS, ROWS)
    assert taken[cv2.CAP_PROP_CONVERT_RGB] == 0
    assert 0 < time.monotonic_ns() - camera.read(BUSY_S).time_ns < BUSY_S * 1e9


def read_on(camera: OpenCVCamera, shapes: set[tuple[int, ...]]) -> None:
    """Read until something is raised, and note the shapes."""
    while True:
        shapes.add(camera.read(BUSY_S).image.shape)


def test_a_camera_whose_frames_change_is_lost_before_a_wrong_one_is_shown(local, open_camera):
    camera = open_camera(0, bits=16)
    shapes: set[tuple[int, ...]] = set()
    with pytest.raises(
        CameraLost, match=rf"^camera 0: its frames are now \({ROWS // 2}, {COLUMNS}\) uint16$"
    ):
        read_on(camera, shapes)
    assert shapes == {(ROWS, COLUMNS)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gain": 3.0}, r"^camera\.gain: 3: the camera does not take it$"),
        ({"pixel_format": "Mono12"}, r'^camera\.pixel_format: "Mono12": allowed: what the camera has of'),
        ({"exposure_s": 0.001}, r"^camera\.exposure_s: 0\.001: the camera makes 0\.003 of it$"),
    ],
)
def test_settings_that_a_local_camera_refuses_are_reported(local, open_camera, options, message, monkeypatch):
    monkeypatch.setattr(local, "least_exposure", 30.0)
    with pytest.raises(InputError, match=message):
        open_camera(0, bits=16, **options)
