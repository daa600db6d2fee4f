"""Prediction of a moving mirror: what it gains, and that it stays out of everything else."""

from collections.abc import Callable

import numpy as np
import pytest
from node_bench import LCD_PER_CAMERA, NodeBench, dent, panel, rest_warp

from zeromethod.control.velocity import Horizon, VelocityPredictor
from zeromethod.rig.model import ControlSpec

REST = rest_warp(384)
WIDE = {"sigma_px": 96.0}
FRAME_S = 1 / 60
MS = 1_000_000


def slide(speed_px_s: float) -> Callable[[float], np.ndarray]:
    return lambda t: dent(REST, 12.0, shift_px=-40 + speed_px_s * max(t - 0.1, 0), **WIDE)


def residuals(bench: NodeBench, frames: int = 40, after: int = 18) -> float:
    """Rms of the residual, camera px, over the frames after the first ones."""
    squares = [taken.residual_rms_px**2 for taken in bench.run(frames)]
    return float(np.sqrt(np.mean(squares[after:])))


def unpredicted(bench: NodeBench) -> NodeBench:
    bench.circle._horizon.learn = lambda age_ns: None  # type: ignore[method-assign]
    return bench


@pytest.mark.parametrize("scan", ["down", "up"])
def test_a_steady_slide_leaves_a_fifth_of_the_residual(scan):
    display = panel().model_copy(update={"scan": scan})
    truth = slide(100.0)
    predicted_bench, late = NodeBench(REST, truth, display), unpredicted(NodeBench(REST, truth, display))
    assert residuals(predicted_bench) < 0.2 * residuals(late)


def test_the_estimate_is_not_predicted():
    truth = slide(100.0)
    bench = NodeBench(REST, truth)
    inner = REST.grid.inner
    for k, _ in enumerate(bench.run(30)):
        if k > 15:
            wrong = bench.circle.controller.estimate - REST.q - truth(bench.mid_s)
            # the newest frame's own measurement: its noise and the filter's curb
            assert np.sqrt(np.mean(wrong[inner] ** 2)) < 0.02
    ahead = bench.circle.controller.commanded - bench.circle.controller.estimate
    assert np.abs(ahead).max() > 0.5


@pytest.mark.parametrize("at_s", 0.2 + np.arange(8) / 8 * FRAME_S)
def test_a_sudden_press_is_not_predicted_wherever_it_falls_in_an_exposure(at_s):
    rest, pressed = np.zeros_like(REST.q), dent(REST, 6.0, **WIDE)
    bench = NodeBench(REST, lambda t: pressed if t > at_s else rest)
    for _ in bench.run(24):
        over = bench.circle.controller.commanded - REST.q - pressed
        along = float(np.sum(over * pressed) / np.sum(pressed**2))
        assert along < 0.01


def test_a_mirror_at_rest_is_not_predicted():
    bench = NodeBench(REST, lambda t: np.zeros_like(REST.q))
    for _ in bench.run(60):
        controller = bench.circle.controller
        # a tenth of a frame's noise, where a chance innovation passes for motion
        assert np.sqrt(np.mean((controller.commanded - controller.estimate) ** 2)) < 0.001


def test_the_end_of_a_motion_ends_the_prediction_within_the_delay():
    bench = NodeBench(REST, lambda t: slide(100.0)(min(t, 0.4)))
    quiet = [taken.residual_rms_px for taken in bench.run(36) if bench.mid_s > 0.4 + 7 * FRAME_S]
    assert max(quiet) < 0.02


def test_the_horizon_is_the_median_age_from_the_first_panel_row():
    for upwards in (False, True):
        horizon = Horizon(upwards)
        assert horizon.age_s is None
        horizon.learn(None)
        for late_ms in (0, 0, 20, 0):  # one frame after a frozen command
            horizon.learn(MS * (np.array([30.0, 40.0, 50.0]) + late_ms))
        expected = [0.05, 0.04, 0.03] if upwards else [0.03, 0.04, 0.05]
        assert horizon.age_s is not None
        np.testing.assert_allclose(horizon.age_s, expected)


def predicted(steps: int, step: np.ndarray, horizon_s: float) -> list[np.ndarray]:
    """Shifts added to commands that move by `step` LCD px a frame, and stand still after `steps`."""
    predictor = VelocityPredictor(REST)
    shifts = []
    for k in range(steps + 2):
        x = np.zeros_like(REST.q) + step * min(k, steps)
        q = REST.q + x
        predictor.add(q, x, np.ones(q.shape[:2]), round(k * FRAME_S * 1e9), np.full(5, horizon_s))
        shifts.append(q - REST.q - x)
    return shifts


def test_a_prediction_waits_for_three_steps_that_agree():
    shifts = [float(shift.mean()) for shift in predicted(5, np.array([0.3, 0.3]), 0.03)]
    full = 0.3 * 0.03 / FRAME_S
    np.testing.assert_allclose(shifts, [0, 0, 0, full, full, full, 0], atol=1e-6)


def test_a_large_prediction_builds_up_over_several_pictures():
    step = np.array([2.0, 0.0])
    shifts = np.array([shift[..., 0].max() for shift in predicted(11, step, 0.1)[:-1]])
    assert shifts[-1] == pytest.approx(2.0 * 0.1 / FRAME_S, rel=1e-6)
    # from picture to picture a third of a period of 16 camera px
    assert np.diff(shifts + 2.0 * np.arange(12)).max() <= 0.34 * 16 * LCD_PER_CAMERA


def test_a_controller_of_low_gain_does_not_predict():
    bench = NodeBench(REST, slide(100.0), control=ControlSpec(gain=0.2))
    for _ in bench.run(20):
        np.testing.assert_array_equal(bench.circle.controller.commanded, bench.circle.controller.estimate)
