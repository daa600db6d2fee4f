"""The live line: what it shows of the states that are recorded."""

import re
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from zeromethod import State, Step
from zeromethod.operating.lasting import LastingState
from zeromethod.surface import Peak
from zeromethod.view.live import LiveStatus
from zeromethod.warp.warp import Role, Warp

FRAME_S = 1 / 60
L, H = State.LOCKED, State.HOLDING


def shown(*states: State) -> list[State]:
    lasting = LastingState()
    return [lasting.see(state, number * FRAME_S) for number, state in enumerate(states)]


@pytest.mark.parametrize("frames", [1, 5, 17])
def test_a_few_frames_that_may_not_be_used_do_not_flash(frames):
    assert shown(L, *[H] * frames, L) == [L] * (frames + 2)


def test_holding_that_lasts_is_shown():
    seen = shown(L, *[H] * 30)
    # 0.3 s at 60 frames a second
    assert seen == [L] * 19 + [H] * 12


@pytest.mark.parametrize("state", [State.NULLING, State.LOST, State.FAULT, State.UNCALIBRATED, State.MOVED])
def test_every_other_state_is_shown_at_once(state):
    assert shown(L, state, H, L) == [L, state, state, L]


def pressed(state: State, reason: str = "") -> Step:
    drawn = Warp.drawn(np.zeros((4, 4, 2)), Role.COMMANDED, 0)
    measured = {"residual_rms_px": 0.012, "valid_share": 0.999, "loop_ms": 3.4, "phase": "slide"}
    peak = Peak(0.2, 40.0, 0.0, 5e-4)
    step = Step(number=1, time_ns=0, time_s=0.0, state=state, commanded=drawn, filtered=drawn, **measured)
    return replace(step, peak=peak, reason=reason, calibrated=True)


def line_of(width: int, step: Step) -> str:
    """What a terminal of so many columns shows in the end."""
    file = StringIO()
    console = Console(file=file, force_terminal=True, width=width, height=20)
    values = {"peak_sigma_mm": 5e-4, "loop_rate_hz": 60.0, "dropped": 2}
    with LiveStatus(console, 1.0, "seconds") as live:
        live.update(step, 1, values)
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", file.getvalue()).split("\r")[-1]


def test_a_narrow_terminal_shows_less_but_never_cuts_state_or_depth():
    assert re.search(
        r"slide +peak .* residual .* valid .* 60 Hz  2 dropped  loop 3.4 ms", line_of(160, pressed(L))
    )
    for width in (80, 60, 50):
        line = line_of(width, pressed(L))
        assert "locked" in line
        assert "peak 200.00 ± 0.50 µm" in line
        assert "…" not in line
        assert ("valid 99.9 %" in line) is (width == 80)


def test_the_reason_of_a_state_is_shown_whole_in_a_narrow_terminal():
    reason = "the camera turned by 0.021 degrees against LCD and prism since the last zero was taken"
    assert reason.split() == [
        word for word in line_of(60, pressed(State.MOVED, reason)).split() if word in reason.split()
    ]


def test_without_a_terminal_a_line_now_and_then_says_how_far_it_is(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr("zeromethod.view.progress.time.monotonic", lambda: now_s[0])
    monkeypatch.setattr("zeromethod.view.progress.EVERY_S", 10.0)
    console = Console(file=StringIO(), width=80)
    with LiveStatus(console, 60.0, "seconds") as live:
        for second in range(31):
            now_s[0] = float(second)
            live.update(replace(pressed(L), time_s=0.5 * second), second)
    lines = console.file.getvalue().splitlines()
    assert [line.partition(":")[0] for line in lines] == [f"{n} of 60 seconds" for n in (5, 10, 15)]
    assert all(re.search("locked  .*peak 200.00 µm", line) for line in lines)


def test_no_figure_that_is_not_known_is_shown():
    nothing = Warp.drawn(np.zeros((4, 4, 2)), Role.COMMANDED, 0)
    step = Step(number=1, time_ns=0, time_s=0.0, state=State.STARTING, commanded=nothing, filtered=nothing)
    console = Console(file=StringIO(), force_terminal=True, width=120)
    with LiveStatus(console, 1.0, "seconds") as live:
        live.update(step, 1)
    words = console.file.getvalue() + repr(step)
    assert "nan" not in words
    assert "waiting for a frame" in words
