"""Optional abilities of devices: asked for safely, whatever somebody else's device has by those names."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.rigs import small_rig
from zeromethod import Rig, Session, open_devices
from zeromethod.clock import SimulatedClock
from zeromethod.devices import abilities
from zeromethod.devices.protocols import PollingDisplay, ScriptedCamera, TruthfulCamera
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
    rig = small_rig(8).replace(
        {"camera.driver": f"{__name__}:LabCam", "scenario": "step", "geometry.known": "exact"}
    )
    with Session(rig) as session:
        assert len(list(session.run(frames=FRAMES))) == FRAMES
        return dict(session.figures)


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
def test_a_scenario_of_another_kind_is_no_script(scenario):
    assert abilities.script_of(SimpleNamespace(scenario=scenario)) is None


@pytest.mark.parametrize(
    "own", [{"scenario": "weekly", "truth": "as it is"}, {"truth": lambda: "the whole truth"}]
)
def test_a_lab_camera_may_have_a_scenario_and_a_truth_of_its_own(monkeypatch, own):
    figures = run_of(monkeypatch, lambda _camera: own)
    assert figures["frames"] == FRAMES
    assert figures["truth"] is None
    assert figures["nulled_frames"] > 0


def test_truth_reports_errors_without_a_scenario(monkeypatch):
    figures = run_of(monkeypatch, lambda camera: {"truth": camera.truth})
    assert figures["truth"]["frames"] == figures["nulled_frames"] > 0
    # at rest at first: the depth error is noise alone, far below a micrometre
    assert 0.0 < figures["truth"]["depth_rms_error_um"] < 1.0


def test_the_simulated_camera_declares_its_abilities():
    rig = small_rig(8)
    with open_devices(rig) as devices:
        assert isinstance(devices.camera, TruthfulCamera)
        assert isinstance(devices.camera, ScriptedCamera)
        assert not isinstance(devices.display, PollingDisplay)
        truth, script = abilities.truth_of(devices.camera), abilities.script_of(devices.camera)
        assert truth is not None
        assert isinstance(truth(0), Mirror)
        assert script.phase_at(0) == "untouched"


NONE: dict[str, Any] = {
    "poll_of": None,
    "warnings_of": (),
    "is_asleep": False,
    "dropped_refreshes_of": None,
    "name_of": "",
    "identity_of": ("", ""),
}


def asked(device: object) -> dict[str, Any]:
    return {name: getattr(abilities, name)(device) for name in NONE}


def test_abilities_are_taken_as_they_are_and_others_are_none():
    poll = [1].clear
    own = SimpleNamespace(
        poll=poll,
        warnings=["dim", "mirrored"],
        asleep=np.True_,
        dropped_refreshes=np.int64(2),
        name="LCD",
        serial="A1",
        model="M",
    )
    assert asked(own) == {
        "poll_of": poll,
        "warnings_of": ("dim", "mirrored"),
        "is_asleep": True,
        "dropped_refreshes_of": 2,
        "name_of": "LCD",
        "identity_of": ("A1", "M"),
    }
    other = SimpleNamespace(poll=3, warnings=True, asleep=abs, dropped_refreshes="2", name=5, serial=7)
    assert asked(object()) == asked(other) == asked(None) == NONE
