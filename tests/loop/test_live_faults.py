"""Every fault of camera, light and time in a closed loop: it is named, the warp holds, it ends well."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from live_bench import GOOD, TIMEOUT_S, TOLD_HOLDING, bench, both_times, held, notes, raising
from live_devices import Eye, small_rig

from zeromethod.devices.opening import Devices, open_devices
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame
from zeromethod.errors import InputError
from zeromethod.loop import loop as loop_module
from zeromethod.loop.events import Event
from zeromethod.loop.live import clock_watch, reopening
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import State


@both_times
def test_a_camera_that_times_out_is_waited_for(real: bool) -> None:
    with bench(real) as b:
        clock = b.devices.clock

        def late(reads: int) -> None:
            if reads <= first + 2:
                clock.sleep_until_ns(clock.now_ns() + round(1e9 * TIMEOUT_S))
                raise CameraTimeout

        first = b.eye.reads
        before = b.loop.step()
        first, b.eye.before_read = b.eye.reads, late
        steps = b.until(lambda step: step.frame_number is not None)
        assert [step.state for step in steps[:-1]] == [State.HOLDING] * 2
        assert all(step.events == (Event.CAMERA_TIMEOUT,) for step in steps[:-1])
        assert held(steps[:-1], before)
        assert "no frame for 0.2 s" in notes(steps)
        assert steps[-2].reason == "no frame for 0.4 s"
        b.settle()


def test_a_camera_that_hangs_is_left_and_opened_anew() -> None:
    with bench(real=True) as b:
        before, old = b.loop.step(), b.eye
        old.before_read = b.hang
        started = time.monotonic()
        steps = b.until(lambda step: Event.CAMERA_REOPENED in step.events)
        # three time-outs of 0.2 s and a grace of 0.1 s, half a second's pause
        assert 1.0 < time.monotonic() - started < 5
        events = [event for step in steps for event in step.events]
        assert events == [*[Event.CAMERA_TIMEOUT] * 2, Event.CAMERA_STALLED, Event.CAMERA_REOPENED]
        assert steps[0].state is State.HOLDING
        assert steps[-2].state is State.FAULT
        assert "the camera is stalled: no frame for 0.6 s; it is opened again in" in steps[-2].reason
        assert held(steps, before)
        assert b.eye is not old
        b.settle()


@both_times
def test_a_camera_that_is_lost_comes_back(real: bool) -> None:
    with bench(real) as b:
        before, old = b.loop.step(), b.eye
        old.before_read = raising(CameraLost("unplugged"))
        old.close = raising(RuntimeError("no such device"))  # type: ignore[method-assign]
        steps = b.until(lambda step: Event.CAMERA_REOPENED in step.events)
        assert steps[0].events == (Event.CAMERA_LOST,)
        assert all(step.state is State.FAULT and "unplugged" in step.reason for step in steps[:-1])
        assert held(steps, before)
        assert "the camera is lost: unplugged\nthe camera was opened again" in notes(steps)
        b.settle()


@both_times
def test_a_loose_plug_is_followed_three_times_a_minute_and_then_ends_the_run(
    real: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if real:
        monkeypatch.setattr(reopening, "WAITS_S", (0.05, 0.1, 0.15))
    opened: list[Eye] = []

    def reopen(devices: Devices) -> Callable[[], Eye]:
        def again() -> Eye:
            eye: Eye = devices.reopen_camera()  # type: ignore[assignment]
            eye.before_read = lambda reads: raising(CameraLost("loose plug"))() if reads > 5 else None
            opened.append(eye)
            return eye

        return again

    with bench(real, reopen=reopen) as b:
        b.eye.before_read = raising(CameraLost("loose plug"))
        steps = b.to_end()
        assert len(opened) == 3
        assert sum(Event.CAMERA_LOST in step.events for step in steps) == 4
        assert any(step.state in GOOD for step in steps)
        assert steps[-1].state is State.FAULT
        assert steps[-1].reason == "the camera is lost: loose plug"


@both_times
def test_a_camera_that_stays_away_ends_the_run_after_three_attempts(
    real: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if real:
        monkeypatch.setattr(reopening, "WAITS_S", (0.05, 0.1, 0.15))
    attempts: list[int] = []

    def never() -> Eye:
        attempts.append(1)
        raise InputError("nothing there")

    with bench(real, reopen=lambda _devices: never) as b:
        before = b.loop.step()
        b.eye.before_read = raising(CameraLost("unplugged"))
        steps = b.to_end()
        assert len(attempts) == 3
        assert steps[-1].state is State.FAULT
        assert (
            steps[-1].reason == "the camera is lost: unplugged; it could not be opened again: nothing there"
        )
        assert held(steps, before)


WRONG = {
    "size": lambda frame: replace(frame, image=frame.image[:-1]),
    "type": lambda frame: replace(frame, image=frame.image.astype(np.float32)),
    "no image": lambda frame: replace(frame, image=None),
    "no time": lambda frame: replace(frame, time_ns=None),
    "no number": lambda frame: replace(frame, number="7"),
    "time is no number": lambda frame: replace(frame, time_ns=float("nan")),
    "exposure is a word": lambda frame: replace(frame, exposure_ns="short"),
    "drops unknown": lambda frame: replace(frame, dropped=None),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_frame_is_a_fault_and_the_next_good_one_ends_it(kind: str) -> None:
    with bench(real=False) as b:
        before = b.loop.step()
        b.eye.alter = WRONG[kind]
        steps = [b.loop.step() for _ in range(3)]
        assert all(step.state is State.FAULT and step.events == (Event.FRAME_WRONG,) for step in steps)
        assert all(step.measured is None and step.dropped == 0 for step in steps)
        assert held(steps, before)
        assert notes(steps) == steps[0].reason  # told once
        b.eye.alter = lambda frame: frame
        b.settle()


@both_times
def test_nothing_but_wrong_frames_ends_the_run(real: bool) -> None:
    with bench(real) as b:
        b.eye.alter = WRONG["size"]
        steps = b.to_end()
        assert steps[-1].state is State.FAULT
        assert "not (128, 160) uint8" in steps[-1].reason
        assert sum(Event.FRAME_WRONG in step.events for step in steps) == loop_module.WRONG_FRAMES_TO_END


@both_times
def test_what_is_no_frame_at_all_names_the_driver_and_ends_the_run(real: bool) -> None:
    with bench(real) as b:
        b.eye.alter = lambda frame: "picture"
        steps = b.to_end()
        assert steps[-1].events == (Event.DEVICE_BROKEN,)
        assert "read() gave str, which lacks image, time_ns" in steps[-1].reason


def test_frames_of_numpy_numbers_and_read_only_images_cost_nothing() -> None:
    def bare(frame: Frame) -> Frame:
        image = np.frombuffer(frame.image.tobytes(), np.uint8).reshape(frame.image.shape)
        assert not image.flags.writeable
        return Frame(
            image,
            np.uint64(frame.time_ns),
            np.uint32(frame.exposure_ns),
            np.uint64(frame.number),
            np.uint8(0),
        )  # type: ignore[arg-type]

    with bench(real=False) as b:
        b.eye.alter = bare
        steps = [b.loop.step() for _ in range(4)]
        assert all(step.state in GOOD and step.events == () for step in steps)
        # what is compiled for writable images would be compiled anew for others: 2 s
        assert max(step.loop_ms for step in steps) < 500


@both_times
def test_too_much_light_is_told_with_what_helps(real: bool) -> None:
    with bench(real) as b:
        before = b.loop.step()
        b.eye.light = lambda _time_s: 4.0
        steps = b.until(lambda step: Event.SATURATED in step.events)
        steps += [b.loop.step() for _ in range(3)]
        assert steps[-1].state is State.LOST
        assert steps[-1].reason == "the camera is blinded: too bright"
        assert "shorten the exposure" in notes(steps)
        # no node is left to go by
        np.testing.assert_allclose(steps[-1].commanded.q, before.commanded.q, atol=0.05)
        b.eye.light = lambda _time_s: 1.0
        b.settle()


@both_times
def test_light_that_goes_out_is_waited_for(real: bool) -> None:
    with bench(real) as b:
        b.eye.light = lambda _time_s: 0.0
        (*_, first) = b.until(lambda step: Event.LIGHT_OFF in step.events)
        steps = [b.loop.step() for _ in range(4)]
        assert all(step.state is State.LOST and step.reason == "the light is off" for step in steps)
        assert all(step.measured is None for step in steps)
        assert held(steps, first)
        b.eye.light = lambda _time_s: 1.0
        b.settle()


def test_a_run_may_begin_in_the_dark() -> None:
    rig = small_rig("live_devices:Eye", "live_devices:Screen")
    with open_devices(rig) as devices:
        eye: Eye = devices.camera  # type: ignore[assignment]
        eye.light = lambda _time_s: 0.0
        loop = Loop(rig, devices.camera, devices.display, devices.clock)
        dark = [loop.step() for _ in range(6)]
        assert not any(step.state in GOOD for step in dark)
        assert held(dark, dark[0])
        eye.light = lambda _time_s: 1.0
        assert [loop.step().state for _ in range(6)][-1] in GOOD


def test_a_backlight_that_beats_with_the_exposure_is_named_and_does_no_harm() -> None:
    with bench(real=False) as b:
        # switched at 123 Hz, seen 60 times a second: 3 Hz
        b.eye.light = lambda time_s: 1 + 0.1 * np.sin(2 * np.pi * 123 * time_s)
        steps = [b.loop.step() for _ in range(90)]
        assert Event.FLICKER in steps[-1].events
        assert all(step.state in GOOD for step in steps)
        # the frequency is looked for in quarters of a cycle in 1.2 s
        (told,) = [note for step in steps for note in step.notes]
        swing, frequency = re.findall(r"swings by (\d+) % at (\S+) Hz", told)[0]
        assert 17 <= int(swing) <= 21
        assert float(frequency) == pytest.approx(3, abs=0.2)
        assert "backlight" in told


@both_times
@pytest.mark.parametrize("jump_s", [-30.0, 30.0])
def test_a_camera_clock_that_jumps_is_followed(real: bool, jump_s: float) -> None:
    with bench(real) as b:
        before = b.loop.step()
        b.eye.alter = lambda frame: replace(frame, time_ns=frame.time_ns + round(1e9 * jump_s))
        steps = b.until(lambda step: Event.CLOCK_JUMPED in step.events)
        # one may be in hand already
        assert len(steps) <= 4
        assert all(step.state in TOLD_HOLDING for step in steps[-3:])
        assert all(step.measured is None for step in steps[-3:])
        assert held(steps[-2:], steps[-3])
        assert f"the camera's clock jumped by {jump_s:+.3g} s: followed" in notes(steps)
        after = b.settle()[-1]
        assert after.time_ns > before.time_ns
        assert after.time_ns < before.time_ns + 20e9


def test_a_host_that_was_suspended_waits_for_fresh_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    slept = [0]
    monkeypatch.setattr(clock_watch, "slept_ns", lambda: slept[0])
    with bench(real=True) as b:
        slept[0] += 90 * 10**9
        steps = b.until(lambda step: Event.CLOCK_JUMPED in step.events)
        assert notes(steps) == "the host was suspended for 90.0 s"
        waiting = [b.loop.step() for _ in range(5)]
        assert all(step.state is State.HOLDING for step in waiting)
        assert waiting[-1].reason == "time stood still: waiting for fresh frames"
        assert held(waiting, steps[-1])
        b.settle()


def test_a_program_that_stood_still_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock_watch, "STOOD_STILL_S", 0.3)
    with bench(real=True) as b:
        b.loop.step()
        time.sleep(1.0)
        steps = b.until(lambda step: Event.CLOCK_JUMPED in step.events, turns=3)
        assert notes(steps).startswith("the program stood still for 1.")
        b.settle()
