"""How late surfaces are, and how many frames were read: figures of a run."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S
from live_devices import small_rig
from recorded_run import small_rig as simulated_rig

import zeromethod as zm
from zeromethod.loop.step import StepFigures
from zeromethod.session.reading import StepReader
from zeromethod.session.summary import _read_figures
from zeromethod.warp.warp import Role, Warp

NOTHING = Warp.drawn(np.zeros((4, 4, 2)), Role.MEASURED, 0)


def step(number: int, time_ns: int) -> zm.Step:
    return zm.Step(
        number=number, time_ns=time_ns, time_s=0.0, state=zm.State.LOCKED, commanded=NOTHING,
        filtered=NOTHING, measured=NOTHING,
    )  # fmt: skip


def test_latency_is_from_mid_exposure_until_the_surface_was_published():
    clock = SimpleNamespace(now_ns=5_000_000)

    def read(one: zm.Step) -> zm.Step:
        clock.now_ns += 20_000_000
        return one

    def publish(_: Any) -> None:
        clock.now_ns += 3_000_000

    reading = StepReader(read, SimpleNamespace(publish=publish), live=False, now_ns=lambda: clock.now_ns)
    reading.post(step(1, time_ns=1_000_000))
    (one,) = reading.collect()
    # 4 ms old when it was posted
    assert one.latency_ms == pytest.approx(4 + 20 + 3)


def test_frames_that_were_not_read_are_counted_and_their_longest_run():
    def record(readable: bool, was_read: bool) -> StepFigures:
        read_ms = 1.0 if was_read else float("nan")
        return StepFigures(
            number=0, time_ns=0, time_s=0.0, state=zm.State.LOCKED, readable=readable, read_ms=read_ms
        )

    pattern = [(1, 1), (1, 0), (0, 0), (1, 0), (1, 1), (1, 0), (1, 1)]
    figures = _read_figures([record(bool(asked), bool(was_read)) for asked, was_read in pattern])
    assert figures == {"frames_to_read": 6, "frames_read": 3, "longest_unread": 2}


def test_a_live_run_states_how_late_its_surfaces_are():
    rig = small_rig("live_devices:RealEye", "live_devices:RealScreen").replace({"control.timeout_s": 5.0})
    with zm.Session(rig) as session:
        steps: list[zm.Step] = []
        for one_step in session.run(seconds=PATIENCE_S):
            steps.append(one_step)
            if len(steps) >= 30 and any(one.surface is not None for one in steps):
                session.loop.stop()
        figures = session.figures
    late = figures["surface_latency_ms"]
    exposure_ms = 1e-6 * max(one.exposure_ns for one in steps)
    assert 0.5 * exposure_ms + figures["read_ms"]["median"] <= late["median"] <= late["p99"] < 5e3
    assert 0 < figures["frames_read"] <= figures["frames_to_read"] <= len(steps)


def test_simulated_time_has_no_latency_and_every_frame_is_read():
    with zm.Session(simulated_rig("hold")) as session:
        list(session.run(frames=12))
        figures = session.figures
    assert figures["surface_latency_ms"] == {"median": None, "p99": None}
    assert figures["frames_read"] == figures["frames_to_read"] > 0
    assert figures["longest_unread"] == 0
