"""The live line: what it shows of the states that are recorded."""

from __future__ import annotations

import pytest

from zeromethod.loop.state import State
from zeromethod.view.live import LastingState

FRAME_S = 1 / 60
L, H = State.LOCKED, State.HOLDING


def shown(*states: State) -> list[State]:
    lasting = LastingState()
    return [lasting.see(state, number * FRAME_S) for number, state in enumerate(states)]


@pytest.mark.parametrize("frames", [1, 5, 17])
def test_a_few_frames_that_may_not_be_used_do_not_flash(frames: int) -> None:
    assert shown(L, *[H] * frames, L) == [L] * (frames + 2)


def test_holding_that_lasts_is_shown() -> None:
    seen = shown(L, *[H] * 30)
    # 0.3 s at 60 frames a second
    assert seen == [L] * 19 + [H] * 12


@pytest.mark.parametrize("state", [State.NULLING, State.LOST, State.FAULT, State.UNCALIBRATED, State.MOVED])
def test_every_other_state_is_shown_at_once(state: State) -> None:
    assert shown(L, state, H, L) == [L, state, state, L]
