"""A camera and a display of somebody else's, by import path from the working directory, close the loop."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import live_devices
import numpy as np
import pytest
from live_devices import Eye, small_rig

from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.devices.opening import open_devices
from zeromethod.errors import InputError
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import State

AWAY_LCD_PX = (1.5, -0.75)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a package with a module `mirror` in the working directory."""
    name = "lab_of_ours"
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").touch()
    shutil.copy(live_devices.__file__, tmp_path / name / "mirror.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    for module in (name, f"{name}.mirror"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return name


@pytest.mark.parametrize(
    ("camera", "display", "clock"),
    [
        ("Eye", "Screen", SimulatedClock),
        ("RealEye", "RealScreen", HostClock),
        ("Eye", "RealScreen", HostClock),
        ("RealEye", "Canvas", HostClock),
    ],
)
def test_devices_by_import_path_null_what_they_see(lab: str, camera: str, display: str, clock: type) -> None:
    rig = small_rig(f"{lab}.mirror:{camera}", f"{lab}.mirror:{display}")
    with open_devices(rig) as devices:
        assert type(devices.camera).__module__ == f"{lab}.mirror"
        assert type(devices.display).__module__ == f"{lab}.mirror"
        assert type(devices.clock) is clock
        eye: Eye = devices.camera  # type: ignore[assignment]
        eye.away_px = np.array(AWAY_LCD_PX)
        with Loop(
            rig, devices.camera, devices.display, devices.clock, reopen_camera=devices.reopen_camera
        ) as loop:
            assert loop.live == (clock is HostClock)
            for step in loop.run(frames=60):
                if step.state is State.LOCKED and step.number > 10:
                    break
            assert step.state is State.LOCKED
            assert step.measured is not None
            error = (step.measured.q - loop.q_rest - AWAY_LCD_PX)[step.measured.valid]
            # 0.01 px of noise per node, and the eye's bilinear look at a carrier of 27 px: 0.5 % of 1.7 px
            assert np.abs(error.mean(axis=0)).max() < 0.02
            assert error.std() < 0.06
            np.testing.assert_allclose(
                (step.commanded.q - loop.q_rest)[step.measured.valid].mean(axis=0), AWAY_LCD_PX, atol=0.03
            )
        assert loop.status.state is State.STOPPED
    assert eye.closed


def test_a_name_that_the_module_lacks_is_told_in_one_line(lab: str) -> None:
    with pytest.raises(InputError, match=r"^camera.driver: 'lab_of_ours.mirror:Ear': cannot be imported: "):
        open_devices(small_rig(f"{lab}.mirror:Ear", f"{lab}.mirror:Screen"))
