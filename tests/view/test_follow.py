"""A recording followed while it is made, in silence, and to its end."""

import io
import threading
from dataclasses import replace

import pytest
from hanging import eventually
from recorded_run import recorded
from rich.console import Console

from zeromethod import Loop, Recording, State, Step
from zeromethod.view.follow import PERIOD_S, FollowDisplay, Glance, Tail, follow

PATIENCE_S = 60.0


KNOWN = Glance(1.0, State.LOCKED, "nulled", 60.0, 0.012, 0.2, 5e-5)


def test_a_run_is_followed_from_before_its_start_through_a_silence_to_its_end(tmp_path):
    path, out = tmp_path / "run.h5", io.StringIO()

    def fall_silent(loop: Loop, step: Step) -> None:
        if step.number == 12:
            eventually(lambda: "no new data for 3 s" in out.getvalue(), PATIENCE_S)

    follower = threading.Thread(target=follow, args=(path, Console(file=out, width=200)), daemon=True)
    follower.start()
    eventually(lambda: "waiting for" in out.getvalue(), PATIENCE_S)
    recorded(path, 0.3, on_step=fall_silent)
    follower.join(PATIENCE_S)
    lines = out.getvalue().splitlines()
    assert lines[0] == f"waiting for {path}"
    assert lines[-1] == "recording ended"
    silence = lines.index("no new data for 3 s")
    assert any("residual" in line for line in lines[1:silence])
    with Recording(path) as recording:
        figures = f"{recording.seconds:8.1f} s  stopped"
        peak_um = 1e3 * recording.peaks["depth_mm"][-1]
    assert lines[-2].startswith(figures)
    assert f"peak {peak_um:.2f} µm" in lines[-2]


def test_rate_is_that_of_the_frames_of_the_last_seconds(recording_path):
    with Recording(recording_path) as recording:
        tail = Tail(recording)
        assert tail.grown()
        assert not tail.grown()
        glance = tail.glance()
    # a steady 60 per second, but for the jitter of a simulated clock
    assert glance.rate_hz == pytest.approx(60.0, rel=0.01)


def test_without_a_terminal_there_is_a_line_per_second_and_one_word_of_silence():
    out, clock = io.StringIO(), [0.0]
    with FollowDisplay(Console(file=out, width=200), now=lambda: clock[0]) as display:
        for tick in range(30):
            clock[0] = tick * PERIOD_S
            display.show(replace(KNOWN, time_s=clock[0]))
        for tick in range(30):
            clock[0] += PERIOD_S
            display.show(KNOWN, silent_s=tick * PERIOD_S)
    lines = out.getvalue().splitlines()
    assert [line.split()[0] for line in lines[:6]] == ["0.0", "1.0", "2.0", "3.0", "4.0", "5.0"]
    assert lines.count("no new data for 3 s") == 1
    assert lines[-1] == "no new data for 3 s"
    assert lines[0].endswith("locked  60.0 frames/s  residual 0.012 px  peak 200.00 µm (sigma 0.05)")


def test_a_terminal_has_one_line_that_says_how_long_nothing_came():
    out = io.StringIO()
    with FollowDisplay(Console(file=out, width=120, force_terminal=True)) as display:
        display.show(replace(KNOWN, dropped=3), silent_s=7.4)
    assert "no new data for 7 s" in out.getvalue()
    assert "dropped 3" in out.getvalue()


def test_a_fault_shows_its_reason_in_place_of_figures():
    assert replace(KNOWN, state=State.FAULT, reason="the camera is lost").words() == "the camera is lost"
    assert Glance().words() == ""


def test_a_file_that_has_just_been_made_is_given_time_to_become_one(recording_path, tmp_path):
    path, out = tmp_path / "begun.h5", io.StringIO()
    path.write_bytes(b"")
    follow(
        path,
        Console(file=out, width=200),
        sleep=lambda _: path.write_bytes(recording_path.read_bytes()) and None,
    )
    assert out.getvalue().splitlines()[-1] == "recording ended"
