from dataclasses import replace

import pytest

from zeromethod.loop.state import (
    LOCK_FRAMES,
    Doubt,
    Outcome,
    State,
    Status,
    StepOutcome,
    next_status,
    sees_target,
)

QUIET = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=1.0)
AT_REST = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=1.0, at_rest=True)
LOUD = StepOutcome(Outcome.MEASURED, residual_rms_px=1.0, valid_share=1.0)
BLIND = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=0.3)
COVERED = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=0.3, covered_share=0.7)
DARK = StepOutcome(Outcome.MEASURED, "the light is off")
HELD = StepOutcome(Outcome.HELD, "held")
FAILED = StepOutcome(Outcome.FAILED, "gone")
STOP = StepOutcome(Outcome.STOP, "asked to")

NULLING, LOCKED, RESTING, LOST = State.NULLING, State.LOCKED, State.RESTING, State.LOST
RUNNING = [s for s in State if s is not State.STOPPED]


def follow(state: State, nulled: int, *steps: StepOutcome) -> list[State]:
    now, states = Status(state, "", nulled), []
    for step in steps:
        now = next_status(now, step)
        states.append(now.state)
    return states


@pytest.mark.parametrize("state", RUNNING)
@pytest.mark.parametrize(
    ("step", "after", "reason"),
    [
        (LOUD, NULLING, "residual 1 px"),
        (BLIND, LOST, "30 % of the nodes are seen"),
        (COVERED, State.COVERED, "70 % of the reflection is gone"),
        (DARK, LOST, "the light is off"),
        (FAILED, State.FAULT, "gone"),
        (STOP, State.STOPPED, "asked to"),
    ],
    ids=["large residual", "few nodes", "covered", "no light", "failed device", "stop"],
)
def test_some_steps_mean_the_same_in_any_state(state, step, after, reason):
    assert next_status(Status(state, "", LOCK_FRAMES), step) == Status(after, reason, 0)


def test_what_comes_shows_once_the_loop_is_nulled_and_until_it_touches():
    coming = replace(AT_REST, coming="touch expected")
    assert follow(NULLING, 0, coming, coming, coming, LOUD) == [NULLING, NULLING, State.APPROACH, NULLING]
    assert follow(State.APPROACH, LOCK_FRAMES, AT_REST, coming) == [RESTING, State.APPROACH]
    moved = replace(coming, doubt=Doubt(State.MOVED, "why"))
    assert follow(State.APPROACH, LOCK_FRAMES, moved) == [State.MOVED]
    passive = replace(coming, passive=True)
    assert follow(State.PASSIVE, LOCK_FRAMES, passive) == [State.APPROACH]


@pytest.mark.parametrize("state", [State.MOVED, State.UNCALIBRATED])
@pytest.mark.parametrize("at_rest", [False, True])
def test_a_doubt_takes_the_place_of_locked_and_resting_until_it_is_gone(state, at_rest):
    doubted = replace(AT_REST if at_rest else QUIET, doubt=Doubt(state, "why"))
    assert follow(NULLING, 0, doubted, doubted, doubted, QUIET) == [NULLING, NULLING, state, LOCKED]
    assert next_status(Status(LOCKED, "", LOCK_FRAMES), doubted).reason == "why"
    assert follow(LOCKED, LOCK_FRAMES, replace(LOUD, doubt=doubted.doubt)) == [NULLING]


@pytest.mark.parametrize("step", [QUIET, LOUD, BLIND, HELD, FAILED, STOP])
def test_stopping_is_final(step):
    stopped = Status(State.STOPPED, "asked to")
    assert next_status(stopped, step) == stopped


@pytest.mark.parametrize("state", RUNNING)
def test_no_new_information_means_holding_but_does_not_hide_starting_lost_or_fault(state):
    after = state if state in {State.STARTING, State.COVERED, State.LOST, State.FAULT} else State.HOLDING
    assert next_status(Status(state, "", 2), HELD) == Status(after, "held", 2)


@pytest.mark.parametrize(
    ("state", "nulled", "steps", "states"),
    [
        (State.STARTING, 0, [QUIET, QUIET, LOUD, QUIET, QUIET, QUIET, QUIET], [NULLING] * 5 + [LOCKED] * 2),
        (NULLING, LOCK_FRAMES - 1, [AT_REST, QUIET, AT_REST, LOUD], [RESTING, LOCKED, RESTING, NULLING]),
        (LOCKED, LOCK_FRAMES, [HELD, QUIET], [State.HOLDING, LOCKED]),
        (LOCKED, LOCK_FRAMES, [HELD, AT_REST], [State.HOLDING, RESTING]),
        (State.FAULT, 0, [QUIET], [NULLING]),
        (LOST, 0, [QUIET], [NULLING]),
    ],
    ids=[
        "three small residuals lock",
        "rest, until a press",
        "a refused frame breaks no lock",
        "nor rest",
        "out of fault",
        "out of lost",
    ],
)
def test_sequences_of_steps(state, nulled, steps, states):
    assert follow(state, nulled, *steps) == states


def test_a_pattern_that_is_never_warped_is_passive_or_rests_and_a_doubt_comes_before():
    loud, at_rest = (replace(step, passive=True) for step in (LOUD, AT_REST))
    passive = [State.PASSIVE] * 2
    assert follow(State.STARTING, 0, loud, at_rest, at_rest, at_rest, loud) == [
        State.PASSIVE, *passive, RESTING, State.PASSIVE
    ]  # fmt: skip
    doubted = replace(loud, doubt=Doubt(State.MOVED, "why"))
    assert follow(State.PASSIVE, 0, doubted, HELD) == [State.MOVED, State.HOLDING]
    assert follow(State.PASSIVE, 0, replace(BLIND, passive=True)) == [LOST]


@pytest.mark.parametrize(
    ("state", "residual_px", "taught"),
    [(LOCKED, 0.01, True), (NULLING, 0.01, False), (State.PASSIVE, 0.01, True), (State.PASSIVE, 5.0, False)],
)
def test_only_frames_that_see_the_target_teach_what_it_looks_like(state, residual_px, taught):
    assert sees_target(state, residual_px) is taught


def test_it_begins_starting_and_states_are_words():
    assert Status().state is State.STARTING
    assert str(State.LOCKED) == "locked"
