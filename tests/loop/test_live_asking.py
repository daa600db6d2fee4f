"""Requests to a running loop: to freeze, to pause, to take a new zero, to stop."""

from __future__ import annotations

import threading
import time

import live_devices
import numpy as np
import pytest
from live_bench import bench, both_times, held, notes, raising
from live_devices import Screen

from zeromethod.devices.protocols import CameraLost
from zeromethod.loop.events import Event
from zeromethod.loop.state import State


@both_times
def test_held_and_paused_loops_measure_and_keep_the_picture(real: bool) -> None:
    with bench(real) as b:
        for ask, state in ((b.loop.freeze, State.HOLDING), (b.loop.pause, State.PAUSED)):
            ask(True)
            # what was commanded before is still shown, once
            b.loop.step()
            before = b.loop.step()
            b.eye.away_px = np.array([2.0, 0.0])
            # frames in flight were taken before
            steps = [b.loop.step() for _ in range(6)]
            assert all(step.state is state for step in steps)
            assert held(steps, before)
            assert steps[-1].measured is not None
            moved = (steps[-1].measured.q - before.commanded.q)[steps[-1].measured.valid]
            # 1 px of noise and interpolation in 100 of 27 px of carrier
            np.testing.assert_allclose(moved.mean(axis=0), [2.0, 0.0], atol=0.05)
            ask(False)
            b.settle()
            b.eye.away_px = 0.0
            b.settle()
        assert not b.loop.paused


@both_times
def test_a_new_zero_takes_slow_drift_out_of_the_reading(real: bool) -> None:
    with bench(real) as b:
        b.eye.away_px = np.array([1.0, -0.5])
        b.until(lambda step: step.state is State.LOCKED)
        b.settle()
        before = b.loop.step()
        b.loop.rezero()
        steps = b.until(lambda step: Event.ZERO_TAKEN in step.events)
        assert "readings start from here now, 1.12 LCD px (rms) from the rig file's rest" in notes(steps)
        assert b.loop.zero is not None
        np.testing.assert_allclose(b.loop.zero.mean(axis=(0, 1)), [1.0, -0.5], atol=0.03)
        step = b.until(lambda step: step.measured is not None)[-1]
        assert step.state is State.RESTING
        left = (step.measured.q - b.loop.q_rest)[step.measured.valid]
        np.testing.assert_allclose(left.mean(axis=0), 0.0, atol=0.03)
        # what is shown is not touched
        np.testing.assert_allclose(step.commanded.q, before.commanded.q, atol=0.3)


def test_a_press_or_a_motion_is_not_called_zero() -> None:
    with bench(real=False) as b:
        rows, columns = b.eye.shape
        y, x = np.mgrid[:rows, :columns].astype(float)
        away = np.stack([x - columns / 2, y - rows / 2], axis=-1) / 16
        dent = 3.0 * away * np.exp(-0.5 * np.sum(away**2, axis=-1, keepdims=True))
        b.eye.away_px = dent
        b.until(lambda step: step.state is State.LOCKED)
        b.loop.rezero()
        steps = b.until(lambda step: Event.ZERO_REFUSED in step.events)
        assert "no new zero: something presses: a dent of" in notes(steps)
        b.eye.away_px = 0.0
        b.settle()
        b.loop.rezero()
        moving = iter(np.arange(0, 100, 0.15))

        def slide(_reads: int) -> None:
            b.eye.away_px = np.array([next(moving), 0.0])

        b.eye.before_read = slide
        steps = b.until(lambda step: Event.ZERO_REFUSED in step.events)
        assert "no new zero: " in notes(steps)
        assert b.loop.zero is None


@pytest.mark.parametrize("what", ["nothing", "camera", "display", "both"])
def test_a_stopped_loop_ends_within_a_second_whatever_hangs(what: str) -> None:
    with bench(real=True) as b:
        if what in {"camera", "both"}:
            b.eye.before_read = b.hang
        if what in {"display", "both"}:
            b.screen.before_show = b.hang
        stopped: list[float] = []

        def stop() -> None:
            stopped.append(time.monotonic())
            b.loop.stop()

        threading.Timer(0.15, stop).start()
        steps = list(b.loop.run())
        assert time.monotonic() - stopped[0] < 1
        assert b.loop.status.state is State.STOPPED
        assert b.loop.ended is not None
        assert b.loop.ended.state is State.STOPPED
        assert all(b.loop.ended.number > step.number for step in steps)


def test_what_ends_a_run_is_its_last_state() -> None:
    with bench(real=False) as b:
        b.eye.before_read = raising(CameraLost("gone"))
        b.loop._source._reopener.close()
        steps = list(b.loop.run())
        assert b.loop.ended is not None
        assert b.loop.ended.state is State.FAULT
        assert b.loop.ended.reason == steps[-1].reason
        assert b.loop.ended.measured is None


def test_the_screen_is_driven_from_one_thread_and_polled_from_the_callers() -> None:
    with bench(real=True) as b:
        threads: set[str] = set()
        b.screen.before_show = lambda _count: threads.add(threading.current_thread().name)
        reading: set[str] = set()
        b.eye.before_read = lambda _reads: reading.add(threading.current_thread().name)
        for _ in range(4):
            b.loop.step()
        assert threads == {"drawing"}
        assert reading == {"capture"}
        assert b.screen.polled_in is threading.current_thread()
    assert isinstance(b.screen, Screen)
    assert b.eye.closed
    assert b.screen.closed
    assert live_devices.Window is type(b.screen)
