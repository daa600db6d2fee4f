"""The controllers in their circle, on a bench of nodes whose panel and camera keep their own time."""

from collections.abc import Callable

import numpy as np
import pytest
from node_bench import LCD_PER_CAMERA, PERIOD_PX, SIGMA_PX, NodeBench, dent, panel, rest_warp

from zeromethod.control.stability_margin import stability_margin
from zeromethod.loop.events import Event
from zeromethod.loop.rest_memory import RestMemory
from zeromethod.loop.state import LOCK_RESIDUAL_PX
from zeromethod.rig.model import ControlSpec
from zeromethod.sensing.residual import Residual

REST = rest_warp(192)
SMALL = {"sigma_px": 32.0}


def step(peak_lcd_px: float, at_s: float = 0.2) -> Callable[[float], np.ndarray]:
    """Press of a moment: nothing before `at_s`, all of it after."""
    rest, pressed = np.zeros_like(REST.q), dent(REST, peak_lcd_px, **SMALL)
    return lambda t: pressed if t > at_s else rest


def frames_to_null(bench: NodeBench, at_s: float = 0.2, frames: int = 60) -> int | None:
    """Frames from the first that sees the press to the first of three nulled ones."""
    nulled = 0
    since = 0
    for taken in bench.run(frames):
        if bench.mid_s <= at_s:
            continue
        since += 1
        good = taken.residual_rms_px < LOCK_RESIDUAL_PX and taken.refusal is None
        nulled = nulled + 1 if good else 0
        if nulled == 3:
            return since - 2
    return None


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def test_a_press_past_half_a_period_is_nulled_in_two_corrections_at_most():
    peak = 0.75 * PERIOD_PX * LCD_PER_CAMERA
    bench = NodeBench(rest_warp(256), lambda t: pressed if t > 0.2 else 0 * pressed)
    pressed = dent(bench.rest, peak)
    commands = 0
    for taken in bench.run(24):
        if bench.mid_s > 0.2 and taken.changed and taken.residual_rms_px > LOCK_RESIDUAL_PX:
            commands += 1
    # each frame still exposed to the old picture measures, and commands, the same again
    assert commands <= 3
    # noise, and the Keys interpolant's h^3 error at a dent of 5 nodes
    assert rms(bench.error_px()) < 0.01


def test_the_command_at_rest_has_less_than_0_4_of_one_frames_noise():
    bench = NodeBench(REST, step(0.0))
    errors, single = [], []
    for k, taken in enumerate(bench.run(90)):
        if k > 30 and taken.measured is not None:
            errors.append(bench.error_px())
            single.append((taken.measured.q - REST.q)[REST.grid.inner])
    assert rms(np.array(single)) == pytest.approx(SIGMA_PX * LCD_PER_CAMERA, rel=0.05)
    assert rms(np.array(errors)) < 0.4 * rms(np.array(single))
    filtered = bench.circle.controller.filtered(0)
    # sqrt(K / (2 - K)) at K = 0.2, what the update's filter takes out besides not counted
    assert filtered.sigma[REST.grid.inner].mean() == pytest.approx(SIGMA_PX * LCD_PER_CAMERA / 3, rel=0.25)


def test_a_press_raises_the_gain_to_its_limit_within_the_frame_that_shows_it():
    pressed = dent(REST, 2.0, **SMALL)
    bench = NodeBench(REST, step(2.0))
    for taken in bench.run(24):
        if bench.mid_s > 0.2 and taken.changed:
            break
    clear = np.zeros(REST.q.shape[:2], dtype=bool)
    clear[REST.grid.inner] = True
    clear &= np.linalg.norm(pressed, axis=-1) > 0.3  # 36 deviations
    assert bench.circle.controller.gain[clear].min() > 0.99


def test_a_held_dent_keeps_its_depth_for_500_frames():
    truth = dent(REST, 5.0, **SMALL)
    bench = NodeBench(REST, lambda t: truth)
    early: list[np.ndarray] = []
    late: list[np.ndarray] = []
    for k, _ in enumerate(bench.run(500)):
        if 40 <= k < 60:
            early.append(bench.error_px())
        if k >= 480:
            late.append(bench.error_px())
    inner_truth = truth[REST.grid.inner]

    def scale(errors: list[np.ndarray]) -> float:
        return float(np.sum(np.mean(errors, axis=0) * inner_truth) / np.sum(inner_truth**2))

    # 0.05 %: no leak; the mean of 20 frames over 169 nodes scatters by 0.003 %
    assert abs(scale(late) - scale(early)) < 5e-4
    assert rms(np.array(late)) < 1.1 * rms(np.array(early))


@pytest.mark.parametrize("delay_frames", [1, 2, 3, 4])
def test_delay_makes_the_composition_late_but_not_unstable(delay_frames):
    bench = NodeBench(REST, step(6.0), display=panel(latency_s=(delay_frames - 1) / 60))
    frames = frames_to_null(bench)
    # the delay itself, the frame that overlaps the change of pictures, and one repetition
    assert frames <= 2 * delay_frames + 4
    assert rms(bench.error_px()) < 0.01


@pytest.mark.parametrize("phase", np.arange(5) / 5)
@pytest.mark.parametrize("refresh_hz", [59.94, 60.0])
@pytest.mark.parametrize(
    ("exposure_s", "rise_s"), [(0.002, 0.004), (0.008, 0.006), (0.016, 0.004), (0.016, 0.006)]
)
def test_no_phase_rate_or_exposure_starves_the_loop(phase, refresh_hz, exposure_s, rise_s):
    bench = NodeBench(
        REST, step(6.0), display=panel(rise_s, refresh_hz), exposure_s=exposure_s, phase=float(phase)
    )
    frames = frames_to_null(bench, frames=26)
    assert frames <= 8  # delay of up to two frames: twice that, and four


@pytest.mark.parametrize(("peak_lcd_px", "learned"), [(0.0, True), (6.0, False)])
def test_a_frozen_loop_learns_the_light_of_the_mirror_at_rest_and_of_no_other(peak_lcd_px, learned):
    bench = NodeBench(REST, step(peak_lcd_px, at_s=0.0))
    taught: list[Residual] = []
    bench.circle._lost_light.learn = taught.append  # type: ignore[method-assign]
    for _ in bench.run(12, frozen=True):
        pass
    assert bool(taught) is learned


def test_mixed_pictures_freeze_the_command_and_are_flagged():
    bench = NodeBench(REST, step(6.0), exposure_s=0.016)
    before = None
    held = 0
    for taken in bench.run(26):
        command = bench.circle.controller.commanded
        if taken.refusal and bench.mid_s > 0.2:
            held += 1
            assert before is not None
            np.testing.assert_array_equal(command, before)
            assert not taken.measured.valid.all()
            assert taken.refusal is Event.PICTURES_MIXED
            valid = taken.measured.valid
            wrong = (taken.measured.q - REST.q - dent(REST, 6.0, **SMALL))[valid]
            # pictures 7 px apart in a dent of 4 nodes: what the mixture leaves out is 0.05 px; noise 5
            # deviations
            assert np.abs(wrong).max() < LCD_PER_CAMERA * (0.05 + 5 * SIGMA_PX)
        before = command
    assert held >= 1


def test_a_slide_is_followed_without_being_taken_for_mixed():
    def truth(t: float) -> np.ndarray:
        return dent(REST, 5.0, shift_px=-15 + 60 * max(t - 0.1, 0), **SMALL)

    bench = NodeBench(REST, truth)
    for k, taken in enumerate(bench.run(36)):
        if k > 10:
            assert taken.changed
            wrong = (taken.measured.q - REST.q - truth(bench.mid_s))[taken.measured.valid]
            # every frame measures absolutely: no lag, whatever the controller does
            assert rms(wrong) < 1.5 * SIGMA_PX


def test_the_integrator_is_slower_leaks_and_diverges_with_delay():
    def integrator(gain: float, leak: float = 0.01, **bench: object) -> NodeBench:
        control = ControlSpec(controller="integrator", gain=gain, leak=leak)
        return NodeBench(REST, step(6.0), control=control, **bench)  # type: ignore[arg-type]

    truth = dent(REST, 6.0, **SMALL)[REST.grid.inner]
    quick = frames_to_null(NodeBench(REST, step(6.0)))
    without_leak = frames_to_null(integrator(0.3, leak=0.0))
    assert without_leak > 3 * quick
    # steady: d = (1 - leak) (d + gain (truth - d)), so that leak / (leak + gain (1 - leak)) of it is missing:
    # 3.3 %, more than a nulled frame may have
    missing = 0.01 / (0.01 + 0.3 * 0.99)
    assert missing * rms(truth) > LOCK_RESIDUAL_PX * LCD_PER_CAMERA
    slow = integrator(0.3)
    assert frames_to_null(slow, frames=120) is None
    errors = np.mean([slow.error_px() for _ in slow.run(40)], axis=0)
    # the mean of 40 frames over 169 nodes scatters by 2e-5 of the press
    assert -np.sum(errors * truth) / np.sum(truth**2) == pytest.approx(missing, abs=1e-4)
    # three frames of extra delay: the linear model's limit of the gain, from both sides
    late = {"display": panel(latency_s=0.05)}
    bench = integrator(0.2, **late)
    assert list(bench.run(100))
    limit = stability_margin(bench.control, 60 * bench.circle.horizon_s).largest_gain
    assert 0.2 < limit < 0.4
    assert rms(bench.error_px()) < 2 * rms(truth) * 0.01 / 0.2
    bench = integrator(0.6, **late)
    early, later = (rms(np.array([bench.error_px() for _ in bench.run(20)])) for _ in range(2))
    assert later > 2 * max(early, rms(truth))


def test_the_state_at_rest_is_distinguished_from_a_light_press():
    for peak, resting in [(0.0, True), (0.5, False)]:
        bench = NodeBench(REST, step(peak, at_s=0.0))
        *_, taken = bench.run(30)
        assert taken.measured is not None
        memory = RestMemory(REST.grid.shape)
        assert memory.at_rest(bench.circle.controller.estimate, taken.measured, REST.q) is resting
