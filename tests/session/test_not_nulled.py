"""Whether a run held the null, by its states alone."""

from dataclasses import replace

import pytest

from zeromethod.loop.state import State
from zeromethod.loop.step import StepFigures
from zeromethod.session.summary import not_nulled, read_until_s

RATE_HZ = 10.0
A, N, R, P, U = State.STARTING, State.NULLING, State.RESTING, State.PAUSED, State.UNCALIBRATED


def records(*parts: tuple[State, float], phase: str = "") -> list[StepFigures]:
    """Steps of each state for so many seconds, and the one that ends the run."""
    states = [state for state, seconds in parts for _ in range(round(RATE_HZ * seconds))]
    times_s = [number / RATE_HZ for number in range(len(states) + 1)]
    return [
        StepFigures(number=number, time_ns=round(1e9 * time_s), time_s=time_s, state=state, phase=phase)
        for number, (time_s, state) in enumerate(zip(times_s, [*states, State.STOPPED], strict=True))
    ]


@pytest.mark.parametrize(
    ("parts", "phase", "when"),
    [
        (((A, 0.1), (N, 3)), "", "in the whole run"),
        (((N, 0.3), (R, 0.3), (N, 8)), "", "in the last 4.2 s"),  # locked at first, thrown off for good
        (((R, 20), (N, 6)), "", "in the last 5.0 s"),
        (((R, 3), (N, 0.5)), "", None),  # a press has just come
        (((N, 8), (R, 0.5)), "", None),
        (((R, 3), (P, 6)), "", None),  # as it was asked for
        (((N, 0.3), (U, 6)), "", None),  # sees the target, and says itself what is wrong
        (((R, 0.3), (N, 8), (R, 0.2)), "slide", None),  # a scenario has its hold for that
        (((R, 3), (N, 0.1)), "slide", "when the run ended"),  # cut off before its hold
        (((N, 3),), "hold", "during the hold"),
    ],
)
def test_a_run_that_is_not_nulled_when_it_should_be_says_when(parts, phase, when):
    assert not_nulled(records(*parts, phase=phase)) == when


@pytest.mark.parametrize(("read_ms", "when"), [(5.0, None), (float("nan"), "during the hold")])
def test_a_surface_for_fingers_is_judged_by_what_was_read(read_ms, when):
    steps = [replace(one, read_ms=read_ms) for one in records((N, 3), phase="hold")]
    assert not_nulled(steps, read_counts=True) == when
    assert not_nulled(steps) == "during the hold"


@pytest.mark.parametrize(
    ("parts", "until_s"),
    [
        (((R, 0.3), (N, 0.5)), 0.2),  # pressed until it ended: the figures are those of before
        (((R, 0.3), (N, 0.5), (R, 0.2)), None),
        (((N, 0.5),), None),  # never read: no figures
    ],
)
def test_figures_of_a_run_that_ends_under_a_press_say_until_when_it_was_read(parts, until_s):
    assert read_until_s(records(*parts)) == (None if until_s is None else pytest.approx(until_s))
