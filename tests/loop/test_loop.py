"""The loop with real pictures: scripted devices for what goes wrong, the simulated bench for the rest."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.against_peers.open_loop import coarser
from zeromethod.clock import SimulatedClock
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost, Frame
from zeromethod.loop import assembly
from zeromethod.loop import loop as loop_module
from zeromethod.loop.events import Event
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import LOCK_RESIDUAL_PX, State
from zeromethod.loop.step import Step
from zeromethod.pattern import Target
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Faults, Rig
from zeromethod.warp.jacobian import jacobian

RIG = binned(load_rig("simulated"), 8)
TARGET = Target.from_spec(RIG.target)
MS = 1_000_000
GOOD = {State.LOCKED, State.RESTING}


class FakeDrawer:
    """Shows nothing; the scripted camera sees the target, as if every picture nulled it."""

    gl_renderer = "none"
    lost = False

    def __init__(self, rig: Rig, display: object, rest: object, strips: object) -> None:
        self.clock: SimulatedClock = display  # type: ignore[assignment]

    def draw(self, q: np.ndarray, code: int | None) -> int:
        if FakeDrawer.lost:
            raise DisplayLost("unplugged")
        return self.clock.now_ns()

    def close(self) -> None:
        pass


class Script:
    """A camera that plays a list: a number = target moved by so many px, an exception, or a frame maker."""

    def __init__(self, clock: SimulatedClock, plan: list[Any]) -> None:
        self.clock = clock
        self.plan = iter(plan)
        self.rng = np.random.default_rng(1)
        self.number = 10
        v, u = np.mgrid[: RIG.camera.rows, : RIG.camera.columns].astype(float)
        self.pixels = u, v

    shape = (RIG.camera.rows, RIG.camera.columns)
    bits = 8

    def image(self, moved_px: float, light: float = 1.0) -> np.ndarray:
        grey = 4 + 190 * light * TARGET.light(self.pixels[0] + moved_px, self.pixels[1])
        return np.clip(np.round(self.rng.normal(grey, 2)), 0, 255).astype(np.uint8)

    def read(self, timeout_s: float) -> Frame:
        item = next(self.plan)
        self.number += 1
        if isinstance(item, BaseException):
            self.clock.sleep_until_ns(self.clock.now_ns() + round(1e9 * timeout_s))
            raise item
        self.clock.sleep_until_ns(self.clock.now_ns() + 50 * MS)
        image = item(self) if callable(item) else self.image(item)
        return Frame(image, self.clock.now_ns() - 8 * MS, 8 * MS, self.number)

    def close(self) -> None:
        pass


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[Loop, list[Step]]]]:
    monkeypatch.setattr(assembly, "Drawer", FakeDrawer)
    FakeDrawer.lost = False

    def run(plan: list[Any], reopened: list[Any] | None = None, **changes: Any) -> tuple[Loop, list[Step]]:
        clock = SimulatedClock(100 * MS)
        reopen = None if reopened is None else lambda: Script(clock, reopened)
        camera, display = Script(clock, plan), clock
        loop = Loop(RIG, camera, display, clock, reopen_camera=reopen)  # type: ignore[arg-type]
        for name, value in changes.items():
            getattr(loop, name)(value)
        steps = [loop.step() for _ in range(len(plan) + len(reopened or [])) if not loop.over]
        return loop, steps

    yield run
    FakeDrawer.lost = False


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


def test_wrong_frames_are_a_fault_that_a_good_frame_ends(play: Any) -> None:
    _, steps = play([0.0, lambda s: s.image(0)[:-1], 0.0])
    assert states(steps) == [State.NULLING, State.FAULT, State.NULLING]
    assert steps[1].events == (Event.FRAME_WRONG,)
    assert steps[1].measured is None


def test_nothing_but_wrong_frames_ends_the_run(play: Any) -> None:
    loop, steps = play([lambda s: s.image(0)[:-1]] * 20)
    assert loop.over
    assert len(steps) == loop_module.WRONG_FRAMES_TO_END
    assert loop.status.state is State.FAULT


def test_timeouts_hold_and_then_are_a_stall(play: Any) -> None:
    timeout = CameraTimeout()
    _, steps = play([0.0, timeout, timeout, 0.0])
    assert states(steps) == [State.NULLING, State.HOLDING, State.HOLDING, State.NULLING]
    loop, steps = play([0.0, timeout, timeout, timeout, 0.0])
    assert states(steps)[-1] is State.FAULT
    assert steps[-1].events == (Event.CAMERA_STALLED,)
    assert loop.over
    assert "3 s" in loop.status.reason


def test_a_lost_camera_is_opened_again(play: Any) -> None:
    _, steps = play([0.0, CameraLost("gone")], reopened=[0.0] * 4)
    assert states(steps)[:4] == [State.NULLING, State.FAULT, State.FAULT, State.NULLING]
    assert steps[1].events == (Event.CAMERA_LOST,)
    assert steps[2].events == (Event.CAMERA_REOPENED,)
    assert states(steps)[-1] is State.RESTING


def test_a_lost_camera_without_a_way_back_ends_the_run(play: Any) -> None:
    loop, steps = play([0.0, CameraLost("gone"), 0.0])
    assert loop.over
    assert states(steps) == [State.NULLING, State.FAULT]
    assert "gone" in loop.status.reason


def test_a_lost_display_ends_the_run_with_its_reason(play: Any) -> None:
    def unplug(script: Script) -> np.ndarray:
        FakeDrawer.lost = True
        return script.image(0.3)

    loop, steps = play([0.0, unplug, 0.0])
    assert loop.over
    assert steps[-1].state is State.FAULT
    assert steps[-1].events == (Event.DISPLAY_LOST,)
    assert "unplugged" in steps[-1].reason


def test_light_off_is_named_and_nothing_is_reported_for_it(play: Any) -> None:
    dark = [lambda s: s.image(0, light=0.0)] * 2
    _, steps = play([0.0, 0.0, 0.0, *dark, 0.0])
    assert states(steps)[3:] == [State.LOST, State.LOST, State.NULLING]
    assert all(step.events == (Event.LIGHT_OFF,) and step.measured is None for step in steps[3:5])
    np.testing.assert_array_equal(steps[4].commanded.q, steps[2].commanded.q)


def test_holding_on_request_measures_but_keeps_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembly, "Drawer", FakeDrawer)
    clock = SimulatedClock(100 * MS)
    moved_px = 0.5
    camera: Any = Script(clock, [0.0] * 3 + [moved_px] * 3)
    loop = Loop(RIG, camera, clock, clock)  # type: ignore[arg-type]
    before = [loop.step() for _ in range(3)][-1]
    assert before.state is State.RESTING
    # the LCD point that a node sees moves by (dq/du) moved_px along u
    bending = jacobian(loop.q_rest, loop.grid.spacing_px)
    moved_lcd_px = (moved_px * bending[..., 0])[loop.grid.inner].mean(axis=(0, 1))
    assert moved_lcd_px[0] > 1

    def away(q: np.ndarray) -> np.ndarray:
        return np.asarray((q - loop.q_rest)[loop.grid.inner].mean(axis=(0, 1)))

    loop.freeze()
    for step in (loop.step(), loop.step()):
        assert step.state is State.HOLDING
        assert step.events == (Event.FROZEN,)
        assert step.frozen
        np.testing.assert_array_equal(step.commanded.q, before.commanded.q)
        assert step.presented == ()
        assert np.isnan(step.draw_ms)
        assert step.residual_rms_px == pytest.approx(moved_px, rel=0.02)
        assert step.measured is not None
        # the mean of 100 nodes and more is known better than one node to its sigma
        one_sigma = step.measured.sigma[loop.grid.inner].mean()
        np.testing.assert_allclose(away(step.measured.q), moved_lcd_px, atol=one_sigma)
    loop.freeze(False)
    step = loop.step()
    assert step.state is State.NULLING
    assert len(step.presented) == 1
    # 50 deviations: the gain is 1 within 1 %
    np.testing.assert_allclose(away(step.commanded.q)[0], moved_lcd_px[0], rtol=0.02)


def test_a_loop_held_from_the_start_shows_rest_and_keeps_its_state(play: Any) -> None:
    loop, steps = play([0.0, 0.5, 0.5], freeze=True)
    assert states(steps) == [State.STARTING] * 3
    for step in steps:
        assert step.events == (Event.FROZEN,)
        np.testing.assert_array_equal(step.commanded.q, loop.q_rest)
        assert step.measured is not None


def test_stopping_and_interrupting_leave_the_loop_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembly, "Drawer", FakeDrawer)

    def fresh(plan: list[Any]) -> Loop:
        clock = SimulatedClock(100 * MS)
        return Loop(RIG, Script(clock, plan), clock, clock)  # type: ignore[arg-type]

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
