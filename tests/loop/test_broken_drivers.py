"""A driver that breaks its contract ends the run, named in the reason; nothing is lost, nothing traced."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.against_peers.open_loop import coarser
from zeromethod.devices.opening import open_devices
from zeromethod.errors import InputError, MeasurementError
from zeromethod.loop.events import Event
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig

RIG = coarser(load_rig("simulated"), 4).model_copy(update={"scenario": "none"})


def raising(error: BaseException) -> Callable[..., Any]:
    def call(*_: object) -> None:
        raise error

    return call


@pytest.mark.parametrize(
    ("device", "method", "breakage", "words"),
    [
        ("camera", "read", raising(ValueError("bad cable")), "ValueError in .*bad cable"),
        ("camera", "read", lambda _timeout_s: None, "TypeError in .*gave NoneType"),
        ("display", "draw", raising(RuntimeError("no GPU")), "RuntimeError in .*no GPU"),
        ("display", "draw", lambda _render: None, "TypeError in "),
    ],
)
def test_what_no_device_may_do_is_a_fault_that_ends_the_run(
    device: str, method: str, breakage: Callable[..., Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_devices(RIG) as devices:
        loop = Loop(RIG, devices.camera, devices.display, devices.clock)
        assert [step.state for step in loop.run(frames=3)]
        loop = Loop(RIG, devices.camera, devices.display, devices.clock)
        monkeypatch.setattr(getattr(devices, device), method, breakage)
        (step,) = loop.run(frames=3)
    assert step.state is State.FAULT
    assert Event.DEVICE_BROKEN in step.events
    assert re.search(words, step.reason)


def test_a_device_that_cannot_be_closed_is_told_and_the_other_closed_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    devices = open_devices(RIG)
    closed = []
    monkeypatch.setattr(devices.display, "close", lambda: closed.append("display"))
    monkeypatch.setattr(devices.camera, "close", raising(RuntimeError("busy")))
    with pytest.raises(MeasurementError, match=r"^camera: cannot be closed: busy$"):
        devices.close()
    assert closed == ["display"]


def test_a_driver_that_cannot_be_built_or_imported_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_lab.py").write_text("raise RuntimeError('sdk\\nnot found')\n")
    monkeypatch.syspath_prepend(tmp_path)
    camera = RIG.camera.model_copy(update={"driver": "broken_lab:Camera"})
    with pytest.raises(InputError, match=r"cannot be imported: sdk not found$"):
        open_devices(RIG.model_copy(update={"camera": camera}))
