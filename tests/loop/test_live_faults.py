"""Every fault of camera, light and time in a closed loop: it is named, the warp stays, it ends well."""

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, raising, takes
from live_bench import GOOD, TIMEOUT_S, bench, both_times, frozen, notes
from live_devices import Eye, small_rig

from zeromethod import Devices, Event, InputError, Loop, State, open_devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame
from zeromethod.loop import display_watch, reopening
from zeromethod.loop import loop as loop_module


def test_a_camera_that_times_out_is_waited_for(either):
    clock = either.devices.clock
    before = either.loop.step()
    first = either.eye.reads

    def late(reads: int) -> None:
        if reads <= first + 2:
            if not either.loop.live:
                clock.sleep_until_ns(clock.now_ns() + round(1e9 * TIMEOUT_S))
            raise CameraTimeout

    either.eye.before_read = late
    steps = either.until(lambda step: step.frame_number is not None)
    assert [(step.state, step.events) for step in steps[:-1]] == [
        (State.HOLDING, (Event.CAMERA_TIMEOUT,))
    ] * 2
    assert frozen(steps[:-1], before)
    assert f"no frame for {TIMEOUT_S:g} s" in notes(steps)
    assert steps[-2].reason == f"no frame for {2 * TIMEOUT_S:g} s"
    either.settle()


def test_a_camera_that_hangs_is_left_and_opened_again(real):
    before, old = real.loop.step(), real.eye
    old.before_read = real.hang
    # three time-outs of 0.2 s and a grace of 0.1 s, half a second's pause
    with real.impatient(), takes(1.0, SOON_S):
        steps = real.until(lambda step: Event.CAMERA_REOPENED in step.events)
    events = [event for step in steps for event in step.events]
    assert events == [*[Event.CAMERA_TIMEOUT] * 2, Event.CAMERA_STALLED, Event.CAMERA_REOPENED]
    assert (steps[0].state, steps[-2].state) == (State.HOLDING, State.FAULT)
    stalled = "the camera is stalled: no frame for 0.6 s; it is "
    assert any(step.reason.startswith(f"{stalled}opened again in") for step in steps)
    assert frozen(steps, before)
    assert real.eye is not old
    real.settle()


def test_a_camera_that_is_lost_comes_back(either):
    before, old = either.loop.step(), either.eye
    old.before_read = raising(CameraLost("unplugged"))
    old.close = raising(RuntimeError("no such device"))  # type: ignore[method-assign]
    steps = either.until(lambda step: Event.CAMERA_REOPENED in step.events)
    assert steps[0].events == (Event.CAMERA_LOST,)
    assert all(step.state is State.FAULT and "unplugged" in step.reason for step in steps[:-1])
    assert frozen(steps, before)
    assert "the camera is lost: unplugged\nthe camera was opened again" in notes(steps)
    either.settle()


@pytest.fixture
def quick_attempts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reopening, "WAITS_S", (0.05, 0.1, 0.15))


@both_times
@pytest.mark.usefixtures("quick_attempts")
def test_a_loose_plug_is_followed_three_times_a_minute_and_then_ends_the_run(in_real_time):
    opened: list[Eye] = []

    def reopen(devices: Devices) -> Callable[[], Eye]:
        def again() -> Eye:
            eye: Eye = devices.reopen_camera()  # type: ignore[assignment]
            eye.before_read = lambda reads: raising(CameraLost("loose plug"))() if reads > 12 else None
            opened.append(eye)
            return eye

        return again

    with bench(in_real_time, reopen=reopen) as b:
        b.eye.before_read = raising(CameraLost("loose plug"))
        steps = b.to_end()
        assert len(opened) == 3
        assert sum(Event.CAMERA_LOST in step.events for step in steps) == 4
        assert any(step.state in GOOD for step in steps)
        assert (steps[-1].state, steps[-1].reason) == (State.FAULT, "the camera is lost: loose plug")


@both_times
@pytest.mark.parametrize(
    ("trouble", "states", "event", "words"),
    [
        (CameraTimeout(), [State.HOLDING] * 2 + [State.FAULT], Event.CAMERA_STALLED, "no frame for 90 s"),
        (CameraLost("gone"), [State.FAULT], Event.CAMERA_LOST, "the camera is lost: gone"),
    ],
)
def test_a_camera_without_a_way_back_ends_the_run(in_real_time, trouble, states, event, words):
    with bench(in_real_time, reopen=lambda _devices: None) as b:
        b.eye.before_read = raising(trouble)
        steps = list(b.loop.run())
        assert [step.state for step in steps] == states
        assert steps[-1].events == (event,)
        assert words in b.loop.status.reason == b.loop.ended.reason == steps[-1].reason
        assert (b.loop.ended.state, b.loop.ended.measured) == (State.FAULT, None)


@both_times
@pytest.mark.usefixtures("quick_attempts")
def test_a_camera_that_stays_away_ends_the_run_when_its_time_is_up(in_real_time):
    attempts: list[int] = []

    def never() -> Eye:
        attempts.append(1)
        raise InputError("nothing there")

    with bench(in_real_time, reopen=lambda _devices: never, reopen_s=0.4) as b:
        before = b.loop.step()
        b.eye.before_read = raising(CameraLost("unplugged"))
        steps = b.to_end()
        # after 0.05, 0.15, 0.3 s, and at the end; a busy machine may be late for some
        assert 1 <= len(attempts) <= 4 if in_real_time else len(attempts) == 4
        assert steps[-1].state is State.FAULT
        assert (
            steps[-1].reason == "the camera is lost: unplugged; it could not be opened again: nothing there"
        )
        assert frozen(steps, before)


def one_row_short(frame: Frame) -> Frame:
    return replace(frame, image=frame.image[:-1])


def test_wrong_frames_are_faults_and_the_next_good_one_ends_them(simulated):
    before = simulated.loop.step()
    simulated.eye.alter = one_row_short
    steps = simulated.step(3)
    assert all(step.state is State.FAULT and step.events == (Event.FRAME_WRONG,) for step in steps)
    assert all(step.measured is None and step.dropped == 0 for step in steps)
    assert frozen(steps, before)
    assert notes(steps) == steps[0].reason  # shown once
    simulated.eye.alter = lambda frame: replace(frame, number=2**70)
    assert simulated.loop.step().frame_number is None  # as it can be recorded
    simulated.eye.alter = lambda frame: replace(frame, dropped=None)
    assert (simulated.loop.step().state, simulated.loop.status.state) == (State.FAULT, State.FAULT)
    simulated.eye.alter = lambda frame: frame
    simulated.settle()


def test_nothing_but_wrong_frames_ends_the_run(either):
    either.eye.alter = one_row_short
    steps = either.to_end()
    assert steps[-1].state is State.FAULT
    assert "not (128, 160) uint8" in steps[-1].reason
    assert sum(Event.FRAME_WRONG in step.events for step in steps) == loop_module.WRONG_FRAMES_TO_END


@pytest.mark.parametrize(
    ("device", "member", "breakage", "words"),
    [
        ("eye", "before_read", raising(ValueError("cable")), r"ValueError in hanging\.py, line \d+: cable"),
        (
            "eye",
            "alter",
            lambda _: "picture",
            r"TypeError in .*: read\(\) gave str, which lacks image, time_ns",
        ),
        ("eye", "before_read", raising(SystemExit(3)), r"SystemExit in hanging\.py, line \d+: 3"),
        ("screen", "before_show", raising(SystemExit(7)), r"SystemExit in hanging\.py, line \d+: 7"),
        ("screen", "before_show", raising(OSError("swap")), r"OSError in hanging\.py.*swap"),
        ("screen", "show", lambda _: None, r"TypeError in .*: show\(\) gave None, not the presentation time"),
    ],
)
def test_a_driver_that_breaks_its_contract_ends_the_run_and_is_named(either, device, member, breakage, words):
    setattr(getattr(either, device), member, breakage)
    steps = either.to_end()
    assert (steps[-1].state, steps[-1].events[-1]) == (State.FAULT, Event.DEVICE_BROKEN)
    assert re.match(words, steps[-1].reason)


def test_frames_of_numpy_numbers_and_read_only_images_cost_nothing(simulated):
    def bare(frame: Frame) -> Frame:
        image = np.frombuffer(frame.image.tobytes(), np.uint8).reshape(frame.image.shape)
        assert not image.flags.writeable
        numbers = np.uint64(frame.time_ns), np.uint32(frame.exposure_ns), np.uint64(frame.number), np.uint8(0)
        return Frame(image, *numbers)  # type: ignore[arg-type]

    simulated.eye.alter = bare
    steps = simulated.step(4)
    assert all(step.state in GOOD and step.events == () for step in steps)
    # what is compiled for writable images would be compiled again for others: 2 s
    assert max(step.loop_ms for step in steps) < 500


def test_too_much_light_is_reported_with_what_helps(either):
    before = either.loop.step()
    either.eye.light = lambda _time_s: 4.0
    steps = either.until(lambda step: Event.SATURATED in step.events) + either.step(3)
    assert (steps[-1].state, steps[-1].reason) == (State.LOST, "the camera is blinded: too bright")
    assert "shorten the exposure" in notes(steps)
    # no node is left to go by
    np.testing.assert_allclose(steps[-1].commanded.q, before.commanded.q, atol=0.05)
    either.eye.light = lambda _time_s: 1.0
    either.settle()


def test_light_that_goes_out_is_waited_for(either):
    either.eye.light = lambda _time_s: 0.0
    (*_, first) = either.until(lambda step: Event.LIGHT_OFF in step.events)
    steps = either.step(4)
    assert all((step.state, step.reason) == (State.LOST, "the light is off") for step in steps)
    assert all(Event.LIGHT_OFF in step.events and step.measured is None for step in steps)
    assert frozen(steps, first)
    either.eye.light = lambda _time_s: 1.0
    either.settle()


@pytest.fixture
def fresh() -> Iterator[tuple[Loop, Eye]]:
    """A loop in simulated time before its first step, and its camera."""
    rig = small_rig("live_devices:Eye", "live_devices:Screen")
    with open_devices(rig) as devices:
        yield Loop(rig, devices.camera, devices.display, devices.clock), devices.camera  # type: ignore[misc]


def test_a_run_may_begin_in_the_dark(fresh):
    loop, eye = fresh
    eye.light = lambda _time_s: 0.0
    dark = [loop.step() for _ in range(6)]
    assert not any(step.state in GOOD for step in dark)
    assert frozen(dark, dark[0])
    eye.light = lambda _time_s: 1.0
    assert [loop.step().state for _ in range(6)][-1] in GOOD


def test_a_loop_frozen_from_the_start_shows_rest_and_keeps_its_state(fresh):
    loop, eye = fresh
    eye.away_px = 0.5
    loop.freeze()
    steps = [loop.step() for _ in range(6)]
    for step in steps:
        assert step.state is State.STARTING
        np.testing.assert_array_equal(step.commanded.q, loop.q_rest)
    assert steps[-1].events == (Event.FROZEN,)
    assert steps[-1].measured is not None


def test_a_backlight_that_beats_with_the_exposure_is_named_and_does_no_harm(simulated):
    # switched at 123 Hz, observed 60 times a second: 3 Hz
    simulated.eye.light = lambda time_s: 1 + 0.1 * np.sin(2 * np.pi * 123 * time_s)
    steps = simulated.step(90)
    assert Event.FLICKER in steps[-1].events
    assert all(step.state in GOOD for step in steps)
    # the frequency is looked for in quarters of a cycle in 1.2 s
    (said,) = [note for step in steps for note in step.notes]
    swing, frequency = re.findall(r"swings by (\d+) % at (\S+) Hz.* backlight", said)[0]
    assert 17 <= int(swing) <= 21
    assert float(frequency) == pytest.approx(3, abs=0.2)


@pytest.mark.parametrize("jump_s", [-30.0, 30.0])
def test_a_camera_clock_that_jumps_is_followed(either, jump_s):
    before = either.loop.step()
    either.eye.alter = lambda frame: replace(frame, time_ns=frame.time_ns + round(1e9 * jump_s))
    steps = either.until(lambda step: Event.CLOCK_JUMPED in step.events)
    # one may be in hand already
    assert len(steps) <= 4
    assert all(step.state in {State.HOLDING, State.FAULT, State.LOST} for step in steps[-3:])
    assert all(step.measured is None for step in steps[-3:])
    assert frozen(steps[-2:], steps[-3])
    assert f"the camera's clock jumped by {jump_s:+.3g} s: followed" in notes(steps)
    after = either.settle()[-1]
    assert before.time_ns < after.time_ns < before.time_ns + 20e9


def test_a_host_that_was_suspended_waits_for_fresh_frames(monkeypatch):
    slept = [0]
    monkeypatch.setattr(display_watch, "slept_ns", lambda: slept[0])
    monkeypatch.setattr(display_watch, "RESYNC_S", PATIENCE_S)
    with bench(real=True) as b:
        slept[0] += 90 * 10**9
        steps = b.until(lambda step: Event.CLOCK_JUMPED in step.events)
        assert notes(steps) == "the host was suspended for 90.0 s"
        waiting = b.step(5)
        assert all(step.state is State.HOLDING for step in waiting)
        assert waiting[-1].reason == "time stood still: waiting for fresh frames"
        assert frozen(waiting, steps[-1])
        b.loop._watch._stale_until_ns = 0
        b.settle()


def test_a_program_that_stood_still_says_so(real):
    real.loop.step()
    watch = real.loop._watch._clock
    longest_s, watch._longest_s = watch._longest_s, 0.5
    time.sleep(1.0)
    steps = real.until(lambda step: Event.CLOCK_JUMPED in step.events, most=3)
    watch._longest_s = longest_s
    assert re.search(r"the program stood still for [1-9]\d*\.\d s", notes(steps))
    real.settle()
