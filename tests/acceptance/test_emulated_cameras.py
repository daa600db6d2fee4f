"""The loop on the emulators of real cameras' libraries, which show what a nulled camera would see.

Their pixels do not depend on what is drawn: so a run can be at rest on them, and lose and regain them,
but not follow a press.
"""

import ctypes
import os
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from fake_gige_camera import ADDRESS, FakeGigECamera
from numpy.typing import NDArray

from zeromethod import Event, Loop, State, Step, load_rig, open_devices
from zeromethod.drivers.aravis_library import LIBRARY
from zeromethod.pattern import Target
from zeromethod.rig.model import CameraSpec, DisplaySpec, Rig

os.environ["PYLON_CAMEMU"] = "2"  # read when pypylon first looks for cameras

PATIENCE_S = 60.0
"""Aravis gives a silent camera five seconds, and the loop's third attempt to open it comes after ten."""


def pictures(rig: Rig) -> NDArray[np.uint8]:
    """(8, rows, columns) what a nulled camera sees; noise makes every one another."""
    rows, columns = rig.camera.rows, rig.camera.columns
    v, u = np.mgrid[:rows, :columns].astype(np.float64)
    light = Target.from_spec(rig.target).light(u, v)
    noise = np.random.default_rng(0).normal(0, rig.camera.noise.read_grey, (8, rows, columns))
    return np.clip(np.rint(rig.camera.noise.black_grey + 200 * light + noise), 0, 254).astype(np.uint8)


def rig_with(driver: str, **options: Any) -> Rig:
    """The packaged rig `virtual` on a camera of `driver`, and on no display."""
    rig = load_rig("virtual")
    fields = {"include": set(CameraSpec.model_fields), "exclude_unset": True}
    camera = rig.camera.model_dump(**fields) | {"driver": driver, "rate_hz": 20.0, "latency_s": 0.0} | options
    fields["include"] = set(DisplaySpec.model_fields)
    display = rig.display.model_dump(**fields) | {"driver": "zeromethod.drivers.blank:BlankDisplay"}
    tables = {"camera": CameraSpec.model_validate(camera), "display": DisplaySpec.model_validate(display)}
    return rig.model_copy(update=tables)


def until(loop: Loop, reached: Callable[[Step], bool]) -> list[Step]:
    """Steps up to the one asked for."""
    steps = []
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s and not loop.over:
        steps.append(loop.step())
        if reached(steps[-1]):
            return steps
    pytest.fail(f"not reached; last: {steps[-1].state}: {steps[-1].reason}")


def rests_is_lost_and_rests_again(rig: Rig, lose: Callable[[], None], regain: Callable[[], None]) -> None:
    with (
        open_devices(rig) as opened,
        Loop(rig, opened.camera, opened.display, opened.clock, reopen_camera=opened.reopen_camera) as loop,
    ):
        nulled = until(loop, lambda step: step.state is State.RESTING)[-1]
        assert nulled.valid_share > 0.98
        lose()
        # a frame that was taken already may still come
        *before, lost = [nulled, *until(loop, lambda step: step.state is State.FAULT)]
        assert {*lost.events} & {Event.CAMERA_LOST, Event.CAMERA_STALLED}
        # the warp stays as it is meanwhile
        last = [step for step in before if step.frame_number is not None][-1]
        np.testing.assert_array_equal(lost.commanded.q, last.commanded.q)
        regain()
        until(loop, lambda step: Event.CAMERA_REOPENED in step.events)
        assert until(loop, lambda step: step.state is State.RESTING)[-1].valid_share > 0.98


@pytest.mark.timeout(180)
def test_a_run_on_pylons_emulator_rests_is_lost_and_rests_again(tmp_path, monkeypatch):
    pylon = pytest.importorskip("pypylon.pylon")
    features = {"TestImageSelector": "Off", "ImageFilename": str(tmp_path), "ImageFileMode": "On"}
    rig = rig_with("pylon", features=features)
    for number, picture in enumerate(pictures(rig)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    opened: list[Any] = []
    instant = pylon.InstantCamera
    monkeypatch.setattr(pylon, "InstantCamera", lambda device: opened.append(instant(device)) or opened[-1])
    rests_is_lost_and_rests_again(
        rig, lambda: opened[0].GetNodeMap().GetNode("FirePnPCallback").Execute(), lambda: None
    )


@pytest.mark.timeout(180)
def test_a_run_on_aravis_fake_camera_rests_is_lost_and_rests_again(tmp_path):
    try:
        ctypes.CDLL(LIBRARY)
    except OSError:
        pytest.skip(f"{LIBRARY} is not installed")
    rig = rig_with("aravis", address=ADDRESS)
    np.save(tmp_path / "pictures.npy", pictures(rig))
    camera = FakeGigECamera(tmp_path / "pictures.npy")
    camera.start()
    try:
        rests_is_lost_and_rests_again(rig, camera.kill, camera.start)
    finally:
        camera.kill()
