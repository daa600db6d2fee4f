"""Optional abilities of devices: asked for safely, whatever somebody else's device has by those names."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from zeromethod.clock import SimulatedClock
from zeromethod.devices import abilities
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import PollingDisplay, ScriptedCamera, TruthfulCamera
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.session.summary import summarise
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.press import Mirror

FRAMES = 12


class LabCam:
    """A lab's camera: the simulated one behind the members of the protocol alone, and `own` attributes."""

    own: Callable[[SimulatedCamera], dict[str, Any]] = staticmethod(lambda _camera: {})

    def __init__(self, rig: Rig, clock: SimulatedClock, display: object) -> None:
        camera = SimulatedCamera(rig, clock, display)
        self.shape, self.bits = camera.shape, camera.bits
        self.read, self.close = camera.read, camera.close
        for name, value in self.own(camera).items():
            setattr(self, name, value)


def run_of(
    monkeypatch: pytest.MonkeyPatch, own: Callable[[SimulatedCamera], dict[str, Any]]
) -> dict[str, Any]:
    monkeypatch.setattr(LabCam, "own", staticmethod(own))
    rig = binned(load_rig("simulated"), 8).replace(
        {"camera.driver": f"{__name__}:LabCam", "scenario": "step"}
    )
    with open_devices(rig) as devices, Session(rig, devices=devices) as session:
        assert type(devices.camera).__name__ == "LabCam"
        assert len(list(session.run(frames=FRAMES))) == FRAMES
        return summarise(session.result)


@pytest.mark.parametrize(
    "scenario",
    [
        "weekly",
        7,
        {"phases": 3},
        lambda: "later",
        SimpleNamespace(phases="hold", duration_s="long"),
        SimpleNamespace(phases=(3,), duration_s=1.0, phase_at=lambda _time_ns: ""),
        SimpleNamespace(phases=(), duration_s=1.0, phase_at="now"),
    ],
    ids=["text", "number", "dict", "method", "other script", "other phases", "no method"],
)
def test_a_scenario_of_another_kind_is_no_script(scenario: object) -> None:
    assert abilities.script_of(SimpleNamespace(scenario=scenario)) is None


def test_a_lab_camera_may_have_a_scenario_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = run_of(monkeypatch, lambda _camera: {"scenario": "weekly", "truth": "as it is"})
    assert figures["frames"] == FRAMES
    assert figures["truth"] is None
    assert figures["nulled_frames"] > 0


def test_truth_reports_errors_without_a_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = run_of(monkeypatch, lambda camera: {"truth": camera.truth})
    assert figures["truth"]["frames"] == figures["nulled_frames"] > 0
    # at rest at first: the depth error is noise alone, far below a micrometre
    assert 0.0 < figures["truth"]["depth_rms_error_um"] < 1.0


def test_a_truth_of_another_kind_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_of(monkeypatch, lambda _camera: {"truth": lambda: "the whole truth"})["truth"] is None


def test_the_simulated_camera_declares_its_abilities() -> None:
    rig = binned(load_rig("simulated"), 8)
    with open_devices(rig) as devices:
        assert isinstance(devices.camera, TruthfulCamera)
        assert isinstance(devices.camera, ScriptedCamera)
        assert not isinstance(devices.display, PollingDisplay)
        truth, script = abilities.truth_of(devices.camera), abilities.script_of(devices.camera)
        assert truth is not None
        assert isinstance(truth(0), Mirror)
        assert script is not None
        assert script.phase_at(0) == "untouched"


def test_displays_without_abilities_have_none() -> None:
    assert abilities.poll_of(object()) is None
    assert abilities.warnings_of(object()) == ()
    assert abilities.is_asleep(object()) is False
    assert abilities.dropped_refreshes_of(object()) is None
    assert abilities.name_of(object()) == ""
    assert abilities.identity_of(None) == ("", "")


def test_attributes_of_another_kind_are_no_abilities() -> None:
    own = SimpleNamespace(
        poll=3, warnings=True, asleep=lambda: False, dropped_refreshes="2", name=5, serial=7
    )
    assert abilities.poll_of(own) is None
    assert abilities.warnings_of(own) == ()
    assert abilities.is_asleep(own) is False
    assert abilities.dropped_refreshes_of(own) is None
    assert abilities.name_of(own) == ""
    assert abilities.identity_of(own) == ("", "")


def test_abilities_are_taken_as_they_are() -> None:
    polled = []
    own = SimpleNamespace(
        poll=lambda: polled.append(1),
        warnings=["dim", "mirrored"],
        asleep=np.True_,
        dropped_refreshes=np.int64(2),
        name="LCD",
        serial="A1",
        model="M",
    )
    poll = abilities.poll_of(own)
    assert poll is not None
    poll()
    assert polled == [1]
    assert abilities.warnings_of(own) == ("dim", "mirrored")
    assert abilities.is_asleep(own) is True
    assert abilities.dropped_refreshes_of(own) == 2
    assert abilities.name_of(own) == "LCD"
    assert abilities.identity_of(own) == ("A1", "M")
