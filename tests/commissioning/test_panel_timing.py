"""Measuring latency, scan-out and rise on the simulated bench: planted ones come back."""

import pytest

from zeromethod import MeasurementError, Rig, open_devices
from zeromethod.calibration.panel_timing import StepTiming
from zeromethod.commissioning.panel_timing import measure_panel_timing

from .setting_up_benches import RIG, planted


def measured(truth: Rig, seconds: float = 1.0, believed: Rig = RIG) -> StepTiming:
    """What is measured of a bench that truly stands as `truth`, by one who believes `believed`."""
    with open_devices(truth) as devices:
        return measure_panel_timing(believed, devices, seconds)


@pytest.mark.parametrize(
    ("latency_s", "scanout_s", "rise_s"), [(0.002, None, 0.004), (0.03, 0.010, 0.012), (0.009, None, 0.020)]
)
def test_a_planted_panel_comes_back(latency_s, scanout_s, rise_s):
    truth = planted(display={"latency_s": latency_s, "scanout_s": scanout_s, "rise_s": rise_s})
    found = measured(truth)
    wanted_s = 1 / RIG.display.refresh_hz if scanout_s is None else scanout_s
    # what is left: the clocks' jitter of 0.1 ms a frame, and lens blur over a band's border
    assert found.latency_s == pytest.approx(latency_s, abs=4e-4)
    assert found.scanout_s == pytest.approx(wanted_s, abs=8e-4)
    assert found.mean_rise_s == pytest.approx(rise_s, abs=8e-4)
    assert not found.upwards


def test_a_panel_that_is_off_is_refused():
    with pytest.raises(MeasurementError, match="does not see the panel change"):
        measured(planted(display={"response_light": (0.0, 1e-9)}))
