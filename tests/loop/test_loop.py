"""The loop with real pictures: scripted devices for what goes wrong, the simulated bench for the rest."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.against_peers.open_loop import coarser
from zeromethod.clock import SimulatedClock
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame
from zeromethod.loop import loop as loop_module
from zeromethod.loop.events import Event
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import LOCK_RESIDUAL_PX, State
from zeromethod.loop.step import Step
from zeromethod.pattern import Target
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Faults, Rig

RIG = binned(load_rig("simulated"), 8)
TARGET = Target.from_spec(RIG.target)
MS = 1_000_000
GOOD = {State.LOCKED, State.RESTING}


class FakeDrawer:
    """Shows nothing; the scripted camera receives the target, as if every picture nulled it."""

    gl_renderer = "none"

    def __init__(self, rig: Rig, display: object, rest: object, strips: object) -> None:
        self.clock: SimulatedClock = display  # type: ignore[assignment]

    def draw(self, q: np.ndarray, code: int | None) -> int:
        return self.clock.now_ns()

    def close(self) -> None:
        pass


class Script:
    """A camera that plays a list: a number = target moved by so many px, or an exception."""

    def __init__(self, clock: SimulatedClock, plan: list[Any]) -> None:
        self.clock = clock
        self.plan = iter(plan)
        self.rng = np.random.default_rng(1)
        self.number = 10
        v, u = np.mgrid[: RIG.camera.rows, : RIG.camera.columns].astype(float)
        self.pixels = u, v

    shape = (RIG.camera.rows, RIG.camera.columns)
    bits = 8

    def image(self, moved_px: float) -> np.ndarray:
        grey = 4 + 190 * TARGET.light(self.pixels[0] + moved_px, self.pixels[1])
        return np.clip(np.round(self.rng.normal(grey, 2)), 0, 255).astype(np.uint8)

    def read(self, timeout_s: float) -> Frame:
        item = next(self.plan)
        self.number += 1
        if isinstance(item, BaseException):
            self.clock.sleep_until_ns(self.clock.now_ns() + round(1e9 * timeout_s))
            raise item
        self.clock.sleep_until_ns(self.clock.now_ns() + 50 * MS)
        return Frame(self.image(item), self.clock.now_ns() - 8 * MS, 8 * MS, self.number)

    def close(self) -> None:
        pass


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> Callable[[list[Any]], Loop]:
    monkeypatch.setattr(loop_module, "Drawer", FakeDrawer)

    def make(plan: list[Any]) -> Loop:
        clock = SimulatedClock(100 * MS)
        return Loop(RIG, Script(clock, plan), clock, clock)  # type: ignore[arg-type]

    return make


@pytest.fixture
def play(fresh: Callable[[list[Any]], Loop]) -> Callable[..., tuple[Loop, list[Step]]]:
    def run(plan: list[Any], freeze: bool = False) -> tuple[Loop, list[Step]]:
        loop = fresh(plan)
        loop.freeze(freeze)
        return loop, [loop.step() for _ in plan if not loop.over]

    return run


def states(steps: list[Step]) -> list[State]:
    return [step.state for step in steps]


def test_three_quiet_frames_at_rest_make_the_loop_rest(play: Any) -> None:
    _, steps = play([0.0] * 4)
    assert states(steps) == [State.NULLING, State.NULLING, State.RESTING, State.RESTING]
    last = steps[-1]
    assert last.measured is not None
    assert last.valid_share == 1
    assert last.residual_rms_px < LOCK_RESIDUAL_PX
    assert last.loop_ms > 0
    # presented at once, 8 ms after mid-exposure; half lit 8.3 ms (scan) and 1.26 ms (rise) later
    assert last.delay_ms == pytest.approx(8 + 8.33 + 1.26, abs=0.02)


def test_every_step_owns_its_arrays(play: Any) -> None:
    _, steps = play([0.0, 0.0, 0.5, 0.5])
    assert steps[1].residual.d[8, 8, 0] == pytest.approx(0, abs=0.05)
    assert steps[2].residual.d[8, 8, 0] == pytest.approx(0.5, abs=0.05)
    assert np.abs(steps[3].commanded.q - steps[1].commanded.q).max() > 0.1


@pytest.mark.parametrize(
    ("trouble", "event", "words"),
    [([CameraTimeout()] * 3, Event.CAMERA_STALLED, "3 s"), ([CameraLost("gone")], Event.CAMERA_LOST, "gone")],
)
def test_a_camera_without_a_way_back_ends_the_run(
    play: Any, trouble: list[Exception], event: Event, words: str
) -> None:
    loop, steps = play([0.0, *trouble, 0.0])
    assert loop.over
    assert states(steps) == [State.NULLING, *[State.HOLDING] * (len(trouble) - 1), State.FAULT]
    assert steps[-1].events == (event,)
    assert words in loop.status.reason


def test_a_loop_frozen_from_the_start_shows_rest_and_keeps_its_state(play: Any) -> None:
    loop, steps = play([0.0, 0.5, 0.5], freeze=True)
    assert states(steps) == [State.STARTING] * 3
    for step in steps:
        assert step.events == (Event.FROZEN,)
        np.testing.assert_array_equal(step.commanded.q, loop.q_rest)
        assert step.measured is not None


def test_stopping_and_interrupting_leave_the_loop_stopped(fresh: Callable[[list[Any]], Loop]) -> None:
    loop = fresh([0.0] * 9)
    assert len(list(loop.run(frames=3))) == 3
    assert loop.status.state is State.STOPPED
    loop = fresh([0.0] * 99)
    assert len(list(loop.run(seconds=0.5))) == 10  # 50 ms a frame
    loop = fresh([0.0] * 9)
    for step in loop.run():
        if step.number == 2:
            loop.stop()
    assert loop.status.state is State.STOPPED
    loop = fresh([0.0, KeyboardInterrupt()])
    with pytest.raises(KeyboardInterrupt):
        list(loop.run())
    assert loop.status.state is State.STOPPED
    loop = fresh([0.0] * 9)
    steps = loop.run()
    next(steps)
    steps.close()
    assert loop.status.state is State.STOPPED


def bench(press: str, factor: int = 4, **simulation: Any) -> Rig:
    rig = coarser(load_rig("simulated"), factor)
    changed = rig.simulation.model_copy(update=simulation)
    return rig.model_copy(update={"scenario": press, "simulation": changed})


def run(rig: Rig, frames: int) -> list[Step]:
    with open_devices(rig) as devices:
        loop = Loop(rig, devices.camera, devices.display, devices.clock, reopen_camera=devices.reopen_camera)
        return list(loop.run(frames=frames))


def test_the_simulated_bench_locks_at_rest_and_on_a_sudden_press() -> None:
    steps = run(bench("step"), 32)
    before = [s for s in steps if s.state is State.RESTING]
    assert before
    pressed = next(k for k, s in enumerate(steps) if s.residual_rms_px > 1)
    locked = next(k for k, s in enumerate(steps) if k > pressed and s.residual_rms_px < LOCK_RESIDUAL_PX)
    # two corrections: the delay is about 2 frames, twice that and 4
    assert locked - pressed <= 8
    assert steps[-1].state is State.LOCKED
    assert steps[-1].valid_share > 0.98
    mixed = [s for s in steps if Event.PICTURES_MIXED in s.events]
    assert mixed
    assert all(s.state is State.HOLDING and s.measured is None for s in mixed)


@pytest.mark.parametrize(
    ("faults", "event", "state"),
    [
        ({"drop_frames": (12, 13)}, Event.FRAMES_DROPPED, None),
        ({"repeat_frames": (12,)}, Event.FRAME_REPEATED, State.HOLDING),
        ({"late_frames": (12,)}, Event.FRAME_LATE, None),
        ({"torn_frames": (12,)}, Event.FRAME_TORN, State.HOLDING),
        ({"stall_at_frame": 12, "stall_s": 1.5}, Event.CAMERA_TIMEOUT, State.HOLDING),
        ({"camera_lost_at_frame": 12, "camera_back_after_s": 1.0}, Event.CAMERA_LOST, State.FAULT),
        ({"light_off_frames": (12, 14)}, Event.LIGHT_OFF, State.LOST),
    ],
)
def test_planted_faults_are_named_survived_and_never_measured_wrong(
    faults: dict[str, Any], event: Event, state: State | None
) -> None:
    steps = run(bench("none", faults=Faults(**faults)), 22)
    named = [s for s in steps if event in s.events]
    assert named
    if state is not None:
        assert named[0].state is state
    assert steps[-1].state in GOOD
    rest = steps[0].commanded.q
    for step in steps:
        if step.measured is not None:
            wrong = (step.measured.q - rest)[step.measured.valid]
            # 0.84 LCD px per camera px; noise 0.01 camera px, the LCD's grid 0.01, no outlier
            assert np.abs(wrong).max() < 0.0625


def test_a_lost_simulated_display_ends_the_run() -> None:
    steps = run(bench("none", faults=Faults(display_lost_at_show=6)), 20)
    assert steps[-1].state is State.FAULT
    assert steps[-1].events == (Event.DISPLAY_LOST,)
