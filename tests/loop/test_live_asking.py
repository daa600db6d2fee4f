"""Requests to a running loop: to freeze, to pause, to take a new zero, to stop."""

import threading
import time

import numpy as np
import pytest
from hanging import SOON_S
from live_bench import bench, frozen, notes

from zeromethod import Event, State
from zeromethod.loop import drawing, frame_source
from zeromethod.session import reading

AWAY_LCD_PX = (1.5, -0.75)


@pytest.mark.parametrize(("real", "display"), [(False, "Screen"), (True, "RealScreen"), (True, "Canvas")])
def test_devices_of_a_labs_own_by_import_path_null_what_they_see(real, display):
    with bench(real, display) as b:
        assert b.loop.live == real
        b.eye.away_px = np.array(AWAY_LCD_PX)
        b.step(10)
        step = b.settle()[-1]
        error = (step.measured.q - b.loop.q_rest - AWAY_LCD_PX)[step.measured.valid]
        # 0.01 px of noise per node, and the eye's bilinear look at a carrier of 27 px: 0.5 % of 1.7 px
        assert np.abs(error.mean(axis=0)).max() < 0.02
        assert error.std() < 0.06
        commanded = (step.commanded.q - b.loop.q_rest)[step.measured.valid].mean(axis=0)
        np.testing.assert_allclose(commanded, AWAY_LCD_PX, atol=0.03)


def test_frozen_and_paused_loops_measure_and_keep_the_picture(either):
    for ask, state in ((either.loop.freeze, State.HOLDING), (either.loop.pause, State.PAUSED)):
        ask(True)
        # what was commanded before is still shown, once
        *_, before = either.step(2)
        either.eye.away_px = np.array([2.0, 0.0])
        # frames in flight were taken before
        steps = either.step(6)
        assert all(step.state is state and step.frozen for step in steps)
        assert all(Event.FROZEN in step.events for step in steps)
        assert frozen(steps, before)
        if not either.loop.live:
            assert all(step.presented == () and np.isnan(step.draw_ms) for step in steps)
        moved = (steps[-1].measured.q - before.commanded.q)[steps[-1].measured.valid]
        # 1 px of noise and interpolation in 100 of 27 px of carrier
        np.testing.assert_allclose(moved.mean(axis=0), [2.0, 0.0], atol=0.05)
        ask(False)
        *_, last = either.settle()
        moved = (last.commanded.q - before.commanded.q)[last.measured.valid]
        np.testing.assert_allclose(moved.mean(axis=0), [2.0, 0.0], atol=0.05)
        either.eye.away_px = 0.0
        either.settle()
    assert not either.loop.paused


def test_a_new_zero_takes_slow_drift_out_of_the_reading(either):
    either.eye.away_px = np.array([1.0, -0.5])
    either.until(lambda step: step.state is State.MOVED)
    either.settle()
    before = either.loop.step()
    either.loop.rezero()
    steps = either.until(lambda step: Event.ZERO_TAKEN in step.events)
    assert "readings start from here now, 1.12 LCD px (rms) from the rig file's rest" in notes(steps)
    np.testing.assert_allclose(either.loop.zero.mean(axis=(0, 1)), [1.0, -0.5], atol=0.03)
    step = either.until(lambda step: step.measured is not None)[-1]
    assert step.state is State.RESTING
    left = (step.measured.q - either.loop.q_rest)[step.measured.valid]
    np.testing.assert_allclose(left.mean(axis=0), 0.0, atol=0.03)
    # what is shown is not touched
    np.testing.assert_allclose(step.commanded.q, before.commanded.q, atol=0.3)


def test_a_press_is_not_called_zero(simulated):
    rows, columns = simulated.eye.shape
    y, x = np.mgrid[:rows, :columns].astype(float)
    away = np.stack([x - columns / 2, y - rows / 2], axis=-1) / 16
    simulated.eye.away_px = 3.0 * away * np.exp(-0.5 * np.sum(away**2, axis=-1, keepdims=True))
    simulated.until(lambda step: step.state is State.LOCKED)
    simulated.loop.rezero()
    steps = simulated.until(lambda step: Event.ZERO_REFUSED in step.events)
    assert "no new zero: something presses: a dent of" in notes(steps)
    assert simulated.loop.zero is None


def test_the_waits_of_an_ending_run_add_up_to_less_than_a_second():
    waits_s = frame_source.SLICE_S + drawing.CLOSING_S + 2.0 * reading.CLOSING_S
    assert waits_s < 1


@pytest.mark.parametrize("what", ["nothing", "camera", "display", "both"])
def test_a_stopped_loop_ends_whatever_hangs(real, what):
    if what in {"camera", "both"}:
        real.eye.before_read = real.hang
    if what in {"display", "both"}:
        real.screen.before_show = real.hang
    stopped: list[float] = []

    def stop() -> None:
        stopped.append(time.monotonic())
        real.loop.stop()

    threading.Timer(0.15, stop).start()
    steps = list(real.loop.run())
    assert time.monotonic() - stopped[0] < SOON_S
    assert real.loop.status.state is real.loop.ended.state is State.STOPPED
    assert all(real.loop.ended.number > step.number for step in steps)


def test_the_screen_is_driven_from_one_thread_and_polled_from_the_callers():
    with bench(real=True) as b:
        drawn_in, read_in = set(), set()
        b.screen.before_show = lambda _count: drawn_in.add(threading.current_thread().name)
        b.eye.before_read = lambda _reads: read_in.add(threading.current_thread().name)
        b.step(4)
        assert (drawn_in, read_in) == ({"drawing"}, {"capture"})
        assert b.screen.polled_in is threading.current_thread()
    assert b.eye.closed
    assert b.screen.closed
