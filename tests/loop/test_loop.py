"""The loop with real pictures, on devices of a lab's own and on the simulated bench."""

from math import log
from typing import Any

import numpy as np
import pytest
from hanging import raising
from small_rigs import with_tables

from benchmarks.against_peers.open_loop import coarser
from zeromethod import Event, Loop, Step, load_rig, open_devices
from zeromethod.loop.state import LOCK_RESIDUAL_PX, State
from zeromethod.resources import resource
from zeromethod.rig.model import Rig


def test_three_quiet_frames_at_rest_make_the_loop_rest(simulated):
    assert [step.state for step in simulated.first[-3:]] == [State.NULLING, State.NULLING, State.RESTING]
    last = simulated.first[-1]
    assert last.measured is not None
    assert last.valid_share == 1
    assert last.residual_rms_px < LOCK_RESIDUAL_PX
    assert last.loop_ms > 0


def test_every_step_owns_its_arrays(simulated):
    before = simulated.first[-1]
    simulated.eye.away_px = np.array([2.0, 0.0])
    after = simulated.step(6)
    # noise of 0.03 px, but where coded strips lie
    assert np.abs(before.residual.d[before.measured.valid]).max() < 0.2
    assert max(step.residual_rms_px for step in after) > 0.4
    assert np.abs(after[-1].commanded.q - before.commanded.q).max() > 1


def test_stopping_and_interrupting_leave_the_loop_stopped(simulated):
    loop = simulated.loop
    assert len(list(loop.run(frames=3))) == 3
    assert loop.status.state is State.STOPPED
    assert len(list(loop.run(seconds=0.5))) == pytest.approx(0.5 * simulated.eye.rate_hz, abs=1)
    steps = []
    for step in loop.run():
        steps.append(step)
        if len(steps) == 2:
            loop.stop()
    assert (len(steps), loop.status.state) == (2, State.STOPPED)
    running = loop.run()
    assert next(running).state is not State.STOPPED
    running.close()
    assert loop.status.state is State.STOPPED
    simulated.eye.before_read = raising(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        list(loop.run())
    assert loop.status.state is State.STOPPED


def bench(press: str, factor: int = 4, **simulation: Any) -> Rig:
    return with_tables(coarser(load_rig("simulated"), factor), scenario=press, simulation=simulation)


def run(rig: Rig, frames: int) -> list[Step]:
    with open_devices(rig) as devices:
        loop = Loop(rig, devices.camera, devices.display, devices.clock, reopen_camera=devices.reopen_camera)
        return list(loop.run(frames=frames))


def test_the_simulated_bench_locks_at_rest_and_on_a_sudden_press(tmp_path):
    # by formula: so steep a change that one exposure shows two different pictures
    step = resource("calibration", "presses", "step.toml").read_text()
    press = tmp_path / "step.toml"
    press.write_text(step.replace('"load"\nwidth_mm = 3.54', '"gaussian"\nsigma_mm = 5.0'))
    rig = bench(str(press))
    steps = run(rig, 32)
    before = [s for s in steps if s.state is State.RESTING]
    assert before
    pressed = next(k for k, s in enumerate(steps) if s.residual_rms_px > 1)
    locked = next(k for k, s in enumerate(steps) if k > pressed and s.residual_rms_px < LOCK_RESIDUAL_PX)
    # two corrections: the delay is about 2 frames, twice that and 4
    assert locked - pressed <= 8
    assert steps[-1].state is State.LOCKED
    assert steps[-1].valid_share > 0.98
    # until the panel's middle row is half lit; its rise is from 10 to 90 %
    lit_ms = 1e3 * (
        rig.display.latency_s + 0.5 / rig.display.refresh_hz + rig.display.rise_s * log(2) / log(9)
    )
    drawn = next(s for s in steps if s.presented and s.presented[-1].source_ns is not None)
    after_ms = 1e-6 * (drawn.presented[-1].time_ns - drawn.presented[-1].source_ns)
    assert drawn.delay_ms == pytest.approx(after_ms + lit_ms)
    mixed = [s for s in steps if Event.PICTURES_MIXED in s.events]
    assert mixed
    assert all(s.state is State.HOLDING and s.measured is None for s in mixed)
