"""What counts of a fine surface, which is made of frames of a while and stays on the screen for a while."""

from zeromethod import State
from zeromethod.operating.fine_doubt import FINE_LATE_S, FRAMES_S, Spoiled


def seen(*steps: tuple[float, State, bool]) -> Spoiled:
    spoiled = Spoiled()
    for time_s, state, new_zero in steps:
        spoiled = spoiled.seen(state, time_s, new_zero)
    return spoiled


def test_what_is_of_now_and_of_a_locked_mirror_counts():
    spoiled = seen((1.0, State.LOCKED, False), (1.1, State.LOCKED, False))
    assert spoiled.doubt("", 1.0, 1.1) == spoiled.doubt("", None, 1.1) == ""
    assert spoiled.doubt("lost: depth does not count", 1.0, 1.1).startswith("lost")


def test_what_grows_old_counts_as_held():
    spoiled = seen((1.0, State.LOCKED, False))
    assert spoiled.doubt("", 1.0, 1.0 + FINE_LATE_S) == ""
    assert "2.1 s ago" in spoiled.doubt("", 1.0, 1.1 + FINE_LATE_S)


def test_what_was_read_from_the_zero_before_does_not_count_but_the_next_does():
    spoiled = seen((1.0, State.LOCKED, False), (1.1, State.LOCKED, True), (1.2, State.RESTING, False))
    assert "zero before" in spoiled.doubt("", 1.0, 1.2)
    assert spoiled.doubt("", 1.1, 1.2) == ""


def test_frames_of_a_bench_that_moved_may_be_in_what_is_read_next():
    spoiled = seen((1.0, State.MOVED, False), (1.1, State.LOCKED, True))
    assert "bench moved" in spoiled.doubt("", 1.0 + FRAMES_S, 2.6)
    assert spoiled.doubt("", 1.01 + FRAMES_S, 2.6) == ""
