import pytest

from zeromethod.loop.state import LOCK_FRAMES, Outcome, State, Status, StepOutcome, next_status

QUIET = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=1.0)
RESTING = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=1.0, at_rest=True)
LOUD = StepOutcome(Outcome.MEASURED, residual_rms_px=1.0, valid_share=1.0)
BLIND = StepOutcome(Outcome.MEASURED, residual_rms_px=0.01, valid_share=0.3)
NOTHING_SEEN = StepOutcome(Outcome.MEASURED, "the light is off")
HELD = StepOutcome(Outcome.HELD, "held")
FAILED = StepOutcome(Outcome.FAILED, "gone")
STOP = StepOutcome(Outcome.STOP, "asked to")

RUNNING = [s for s in State if s is not State.STOPPED]


def status(state: State, nulled: int = 0) -> Status:
    return Status(state, "", nulled)


@pytest.mark.parametrize("state", RUNNING)
def test_a_large_residual_means_nulling_from_any_state(state: State) -> None:
    after = next_status(status(state, LOCK_FRAMES), LOUD)
    assert after.state is State.NULLING
    assert after.nulled_frames == 0


def test_three_small_residuals_running_make_a_lock_and_two_do_not() -> None:
    now = Status()
    assert now.state is State.STARTING
    states = []
    for turn in [QUIET, QUIET, LOUD, QUIET, QUIET, QUIET, QUIET]:
        now = next_status(now, turn)
        states.append(now.state)
    assert states == [State.NULLING] * 5 + [State.LOCKED] * 2


def test_a_lock_at_rest_is_resting_and_a_press_ends_it() -> None:
    now = next_status(status(State.NULLING, LOCK_FRAMES - 1), RESTING)
    assert now.state is State.RESTING
    assert next_status(now, QUIET).state is State.LOCKED
    assert next_status(next_status(now, QUIET), RESTING).state is State.RESTING
    assert next_status(now, LOUD).state is State.NULLING


@pytest.mark.parametrize("state", RUNNING)
@pytest.mark.parametrize("turn", [BLIND, NOTHING_SEEN])
def test_few_nodes_seen_means_lost_from_any_state(state: State, turn: StepOutcome) -> None:
    after = next_status(status(state, LOCK_FRAMES), turn)
    assert after.state is State.LOST
    assert after.reason
    assert after.nulled_frames == 0


def test_lost_gives_the_light_as_its_reason_when_it_is_off() -> None:
    assert next_status(Status(), NOTHING_SEEN).reason == "the light is off"


@pytest.mark.parametrize("state", [State.NULLING, State.LOCKED, State.RESTING, State.HOLDING])
def test_no_new_information_means_holding(state: State) -> None:
    after = next_status(status(state, 2), HELD)
    assert (after.state, after.reason, after.nulled_frames) == (State.HOLDING, "held", 2)


@pytest.mark.parametrize("state", [State.STARTING, State.LOST, State.FAULT])
def test_holding_does_not_hide_starting_lost_or_fault(state: State) -> None:
    after = next_status(status(state), HELD)
    assert (after.state, after.reason) == (state, "held")


def test_a_held_frame_does_not_break_a_lock() -> None:
    now = next_status(status(State.LOCKED, LOCK_FRAMES), HELD)
    assert next_status(now, QUIET).state is State.LOCKED
    assert next_status(now, RESTING).state is State.RESTING


@pytest.mark.parametrize("state", RUNNING)
def test_a_failed_device_means_fault_from_any_state(state: State) -> None:
    after = next_status(status(state, 5), FAILED)
    assert (after.state, after.reason, after.nulled_frames) == (State.FAULT, "gone", 0)


@pytest.mark.parametrize("state", [State.FAULT, State.LOST])
def test_a_good_frame_leads_out_of_fault_and_lost_by_way_of_nulling(state: State) -> None:
    assert next_status(status(state), QUIET).state is State.NULLING


@pytest.mark.parametrize("state", RUNNING)
def test_stopping_works_from_any_state_and_is_final(state: State) -> None:
    stopped = next_status(status(state), STOP)
    assert (stopped.state, stopped.reason) == (State.STOPPED, "asked to")
    for turn in (QUIET, LOUD, BLIND, HELD, FAILED, STOP):
        assert next_status(stopped, turn) == stopped


def test_states_are_words() -> None:
    assert str(State.LOCKED) == "locked"
