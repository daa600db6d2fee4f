"""A session as a person uses it: run, look, run again; closed, interrupted, recorded, on any devices."""

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import recorded_run
from hanging import PATIENCE_S, eventually
from live_devices import RealEye, small_rig

import zeromethod as zm
from zeromethod.devices.protocols import CameraLost
from zeromethod.exposure.delay import DelayEstimator
from zeromethod.exposure.strip_matching import Match
from zeromethod.loop.state import LOCK_FRAMES, NULLED
from zeromethod.session.delay_note import DelayNote

LIVE = ("read surface", "present", "capture", "draw")


def simulated_rig(press: str) -> zm.Rig:
    """As coarse as a loop can null: what a session does does not depend on how well it reads."""
    return recorded_run.small_rig(press, factor=8)


def live_rig() -> zm.Rig:
    return small_rig("live_devices:RealEye", "live_devices:RealScreen")


@pytest.fixture
def session() -> Iterator[zm.Session]:
    with zm.Session(simulated_rig("hold")) as opened:
        yield opened


@pytest.mark.parametrize(
    ("scatter_ms", "words"), [(0.5, "delay 20.0 ms"), (30.0, "not steady: it scatters by")]
)
def test_the_delay_is_noted_once_and_only_when_its_scatter_is_known(session, scatter_ms, words):
    estimator = DelayEstimator(0.0, 16.7e6)
    loop = SimpleNamespace(delay=SimpleNamespace(estimator=estimator), horizon_s=0.03)
    said: list[str] = []
    note = DelayNote(session.rig, loop, session.result)
    for number in range(60):
        # the first frames agree by chance
        off_ms = 0.0 if number < 5 else scatter_ms * (-1) ** number
        delay_ns = 1e6 * (20.0 + off_ms)
        estimator.note(Match(True, best_ns=delay_ns, low_ns=delay_ns, high_ns=delay_ns, blur_ns=0.0))
        notes = note.take()
        assert not (notes and number < 20)
        said += notes
    assert len(said) == 1
    assert words in said[0]
    assert (session.result.margin is None) == (scatter_ms > 10)


@pytest.mark.parametrize(
    ("rubber", "said"), [({}, True), ({"support": "free"}, False), ({"body": "none"}, False)]
)
def test_a_run_says_once_at_its_start_that_what_holds_the_rubber_is_not_known(rubber, said):
    rig = simulated_rig("none").replace({"rubber": rubber})
    with zm.Session(rig) as session:
        first, *later = [*session.run(frames=1), *session.run(frames=1)]
        assert any("rubber.support is not given" in note for note in first.notes) == said
        assert not any("rubber" in note for step in later for note in step.notes)
        assert session.figures["notes"] == list(first.notes)
    assert all("\n" not in note for note in first.notes)


def test_a_second_run_locks_at_once_and_steps_and_time_go_on():
    with zm.Session(recorded_run.small_rig("hold")) as session:
        first = list(session.run(seconds=0.6))
        assert first[-1].state is zm.State.LOCKED
        assert first[-1].peak is not None
        assert session.loop.status.state is zm.State.STOPPED
        second = list(session.run(frames=5))
    assert [step.state for step in second[: LOCK_FRAMES - 1]] == [zm.State.NULLING] * (LOCK_FRAMES - 1)
    assert [step.state for step in second[LOCK_FRAMES - 1 :]] == [zm.State.LOCKED] * (6 - LOCK_FRAMES)
    numbers = [step.number for step in [*first, *second]]
    assert numbers == sorted(set(numbers))
    times = [step.time_s for step in [*first, *second]]
    period_s = 1 / session.rig.camera.rate_hz
    np.testing.assert_allclose(np.diff(times[-7:]), period_s, rtol=0.2)
    # the mirror is still pressed: the readings go on where they were
    assert second[0].peak is not None
    assert second[0].peak.depth_mm == pytest.approx(first[-1].peak.depth_mm, rel=1e-3)
    assert session.result.dropped == 0


def test_figures_are_those_of_both_runs(session):
    list(session.run(frames=6))
    assert session.figures["frames"] == 6
    list(session.run(frames=4))
    assert session.figures["frames"] == 10
    assert [record.number for record in session.result.records] == [*range(1, 7), *range(8, 12)]
    assert not session.result.interrupted
    assert session.figures["state"] == str(session.result.records[-1].state)


def test_a_run_that_is_left_ends_when_the_next_one_begins(session):
    steps = session.run()
    for _ in range(3):
        next(steps)
    again = session.run(frames=2)
    assert session.loop.status.state is zm.State.STOPPED
    assert list(steps) == []
    assert [step.number for step in again] == [5, 6]


def test_another_run_may_begin_in_the_body_of_a_loop(session):
    for step in session.run(frames=30):
        if step.number == 3:
            assert len(list(session.run(frames=2))) == 2
    assert session.result.frames == 5


def test_an_error_in_the_callers_body_ends_the_run_and_the_session_closes():
    session = zm.Session(simulated_rig("none"))

    def broken() -> None:
        with session:
            for step in session.run(seconds=10):
                if step.number == 3:
                    raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        broken()
    assert session.loop.ended.state is zm.State.STOPPED
    assert session.result.frames == 3


def test_after_an_error_in_the_callers_body_the_session_runs_on(session):
    def broken() -> None:
        for _ in session.run(seconds=10):
            raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        broken()
    assert [step.number for step in session.run(frames=2)] == [3, 4]


def test_a_closed_session_refuses_in_one_line_and_closes_again():
    session = zm.Session(simulated_rig("none"))
    steps = session.run(frames=8)
    next(steps)
    session.close()
    assert list(steps) == []
    with pytest.raises(zm.InputError, match=r"^session: it is closed: open a new one$"):
        session.run(frames=1)
    session.close()
    assert "closed" in repr(session)
    assert session.result.frames == 1


def test_an_interrupt_ends_one_run_and_not_the_next(session):
    for step in session.run(seconds=10):
        if step.number == 3:
            session.interrupt()
    assert session.result.interrupted
    assert session.result.frames == 3
    assert len(list(session.run(frames=2))) == 2
    assert not session.result.interrupted
    session.interrupt()
    assert len(list(session.run(frames=2))) == 2


def test_an_interrupt_before_the_first_run_ends_it(session):
    session.interrupt()
    assert list(session.run(frames=5)) == []
    assert session.result.interrupted


def test_ctrl_c_in_the_loop_ends_the_run_with_what_it_has(session):
    def press() -> None:
        if session.loop._steps == 4:
            raise KeyboardInterrupt

    session.loop.on_wait = press
    assert len(list(session.run(frames=10))) == 3
    assert session.result.interrupted


def test_ctrl_c_in_the_callers_body_is_the_callers(session):
    def press() -> None:
        for _ in session.run(frames=10):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        press()
    assert len(list(session.run(frames=2))) == 2


def test_devices_that_were_given_stay_open():
    rig = simulated_rig("none")
    with zm.open_devices(rig) as devices:
        for _ in range(2):
            with zm.Session(rig, devices=devices) as session:
                assert len(list(session.run(frames=3))) == 3
        assert devices.camera.read(1.0).image.shape == devices.camera.shape


def test_an_unknown_rig_is_refused():
    with pytest.raises(zm.InputError, match=r"simulatedd.*simulated,"):
        zm.Session("simulatedd")


def test_a_recording_holds_both_runs_and_reads_again_bit_for_bit(tmp_path):
    path = tmp_path / "two.h5"
    with zm.Session(simulated_rig("hold"), record=path) as session:
        numbers = [step.number for _ in range(2) for step in session.run(frames=5)]
    assert session.result.recording_trouble == ""
    with zm.open_recording(path) as recording:
        assert recording.complete
        steps = recording.steps
        assert steps["number"][steps["frame_number"] >= 0].tolist() == numbers
        stopped = [recording.state_of(row) for row in steps].count(zm.State.STOPPED)
        assert stopped == 2
        assert zm.replay(recording)["equal"]
    with pytest.raises(zm.InputError, match=r"two\.h5"):
        zm.Session(simulated_rig("hold"), record=path)


def test_run_by_itself_gives_the_result():
    seen: list[zm.Step] = []
    result = zm.run(simulated_rig("none"), frames=4, on_step=seen.append)
    assert result.frames == len(seen) == 4
    assert zm.summarise(result)["frames"] == 4


def running() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name in LIVE]


def until_read(session: zm.Session) -> list[zm.Step]:
    """Steps of a run: at least 25, until one is nulled and has its reading."""
    steps: list[zm.Step] = []
    for step in session.run(seconds=PATIENCE_S):
        steps.append(step)
        if len(steps) >= 25 and step.state in NULLED and any(one.surface is not None for one in steps):
            session.loop.stop()
    assert any(step.surface is not None for step in steps)
    return steps


@pytest.mark.timeout(200)
def test_live_a_second_run_reads_on_without_a_new_process_and_drops_nothing_between():
    with zm.Session(live_rig()) as session:
        first = until_read(session)
        process = session._surfaces._process
        assert process is not None
        eventually(lambda: "read surface" not in running())
        time.sleep(0.5)  # 30 frames, none of which counts as dropped
        second = until_read(session)
        assert session._surfaces._process is process
        # but for a frame that a busy machine draws or reads too late
        assert sum(step.state in NULLED for step in second) > len(second) - 3 * LOCK_FRAMES
        assert second[0].dropped == 0
        assert second[0].number == first[-1].number + 2
        assert second[0].time_s > first[-1].time_s + 0.4
    eventually(lambda: running() == [])
    assert process._process.returncode is not None


@pytest.mark.usefixtures("no_process")
def test_live_a_camera_that_came_back_serves_the_next_run():
    def lose(_reads: int) -> None:
        raise CameraLost("cable is out")

    with zm.Session(live_rig()) as session:
        eye = session._devices.camera
        assert isinstance(eye, RealEye)
        for step in session.run(frames=20):
            if step.number == 5:
                eye.before_read = lose
        assert "the camera was opened again" in session.result.notes
        assert {step.state for step in session.run(frames=12)} & NULLED


@pytest.mark.usefixtures("no_process")
def test_live_an_error_in_reading_ends_the_run_and_the_next_one_reads(monkeypatch):
    def broken(_step: object) -> Any:
        raise FloatingPointError("surface")

    with zm.Session(live_rig()) as session:
        with monkeypatch.context() as patch:
            patch.setattr(session, "_read", broken)
            with pytest.raises(FloatingPointError, match="surface"):
                list(session.run(seconds=PATIENCE_S))
        assert session.loop.status.state is zm.State.STOPPED
        assert not session.loop.over
        read = any(step.surface is not None for step in session.run(seconds=PATIENCE_S))
        assert read, (session, session.result.events, session.result.notes)


def test_a_session_publishes_at_an_address():
    zmq = pytest.importorskip("zmq")
    with zm.Session(simulated_rig("none"), publisher="tcp://127.0.0.1:*") as session:
        context = zmq.Context()
        socket = context.socket(zmq.SUB)
        socket.connect(session._publisher.address)  # type: ignore[union-attr]
        socket.subscribe(b"")
        # a subscriber is heard of when it is
        eventually(lambda: list(session.run(frames=1)) and socket.poll(20))
        socket.close()
        context.term()
    with pytest.raises(zm.InputError, match="nowhere"):
        zm.Session(simulated_rig("none"), publisher="nowhere")
