"""The live line: what it shows of the states that are recorded."""

from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from zeromethod import State, Step
from zeromethod.operating.lasting import LastingState
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


def test_no_figure_that_is_not_known_is_shown():
    nothing = Warp.drawn(np.zeros((4, 4, 2)), Role.COMMANDED, 0)
    step = Step(number=1, time_ns=0, time_s=0.0, state=State.STARTING, commanded=nothing, filtered=nothing)
    console = Console(file=StringIO(), force_terminal=True, width=120)
    with LiveStatus(console, 1.0, "seconds") as live:
        live.update(step, 1)
    words = console.file.getvalue() + repr(step)
    assert "nan" not in words
    assert "waiting for a frame" in words
