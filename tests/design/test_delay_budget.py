"""The way round the loop, step by step, as a sum done by hand."""

import numpy as np
import pytest

from zeromethod.design import SampledView
from zeromethod.design.delay_budget import delay_budget, total_s

from .design_benches import small, telecentric


def budget(computing_s: float = 0.0, **parts):
    return {step.name: step for step in delay_budget(SampledView(telecentric(**parts)), computing_s)}


def test_the_sum_is_that_of_its_steps():
    display = {"refresh_hz": 50.0, "latency_s": 0.03, "scanout_s": 0.0, "rise_s": 0.0}
    steps = budget(0.01, display=display, camera={"rate_hz": 25.0, "exposure_s": 0.02, "latency_s": 0.005})
    total = total_s(list(steps.values()))
    # exposure / 2, readout, computing, half a refresh, latency, half a frame
    assert total.mean_s == pytest.approx(0.01 + 0.005 + 0.01 + 0.01 + 0.03 + 0.02)
    assert total.worst_s == pytest.approx(total.mean_s + 0.01 + 0.02)


def test_scan_out_reaches_the_rows_that_are_seen():
    view = SampledView(telecentric(display={"scan": "down", "scanout_s": 0.01}))
    rows = view.trace.q[view.on_lcd][:, 1] / (view.rig.display.rows - 1)
    down = budget(display={"scan": "down", "scanout_s": 0.01})["scan-out to the rows in view"]
    up = budget(display={"scan": "up", "scanout_s": 0.01})["scan-out to the rows in view"]
    assert down.worst_s == pytest.approx(0.01 * rows.max())
    assert up.worst_s == pytest.approx(0.01 * (1 - rows.min()))
    assert down.mean_s + up.mean_s == pytest.approx(0.01)


def test_a_rise_from_10_to_90_percent_delays_by_its_time_constant():
    rise = budget(display={"rise_s": 0.004})["rise of the pixels"].mean_s
    # mean delay of an exponential, by quadrature of 1 - step
    time_s = np.linspace(0, 0.1, 100001)
    tau_s = 0.004 / np.log(9)
    assert rise == pytest.approx(np.trapezoid(np.exp(-time_s / tau_s), time_s), rel=1e-4)


def test_a_simulated_camera_has_the_simulations_latency_unless_given():
    def latency_s(rig) -> float:
        return next(s.mean_s for s in delay_budget(SampledView(rig), 0.0) if s.name == "readout and transfer")

    rig = small()
    camera = rig.camera.model_copy(update={"driver": "pylon"})
    assert "latency_s" not in rig.camera.model_fields_set or rig.camera.latency_s == 0.0
    assert latency_s(rig.model_copy(update={"camera": camera})) == 0.0
