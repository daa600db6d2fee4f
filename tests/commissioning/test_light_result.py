"""What a person reads of the light: every notable thing with what to do about it."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from zeromethod.calibration.falloff import Falloff
from zeromethod.calibration.panel_faults import Fault, FaultCheck
from zeromethod.commissioning import light_result
from zeromethod.commissioning.light_result import LightResult

EVEN, DIM = np.ones((4, 4)), np.ones((4, 4))
DIM[3, 0] = 0.08


def result(light: np.ndarray, overdrive: float) -> LightResult:
    quiet: Any = SimpleNamespace(notes=())
    finding = FaultCheck(Fault.OVERDRIVE, overdrive, 1e-4, "the light goes past")
    falloff = Falloff(light, light)
    none: Any = None
    return LightResult(quiet, none, none, quiet, none, falloff, (finding,), none, 0.1, ("a note",))


def test_everything_notable_is_said_with_what_to_do(monkeypatch):
    monkeypatch.setattr(light_result, "spread_left", lambda *_: 0.05)
    fault, region, viewing, note = result(DIM, 0.1).advice
    assert fault.startswith("overdrive: the light goes past: switch off overdrive")
    assert region.startswith("region 4, 1 of 4 x 4 (row, column) has 8 % of the brightest")
    assert "viewing direction" in viewing
    assert "5.0 %" in viewing
    assert note == "a note"


def test_what_is_well_is_not_mentioned(monkeypatch):
    monkeypatch.setattr(light_result, "spread_left", lambda *_: 0.0)
    assert result(EVEN, 0.0).advice == ("a note",)
