"""What is watched apart from the frames, the notices to the operator, and garbage collection."""

import gc
import sys

import pytest

from zeromethod.loop.display_watch import RESYNC_S, STOOD_STILL_S, ClockWatch, DisplayWatch
from zeromethod.loop.events import QUIET_STEPS, Event, Notice, Notices
from zeromethod.loop.paused_gc import COLLECTED_ABOVE, SWITCH_S, PausedGC


def test_displays_without_such_members_raise_no_notice():
    watch = DisplayWatch(object(), None)  # type: ignore[arg-type]
    watch.poll()
    assert watch.look(0) == []
    # simulated time does not stand still by itself, however long a step is
    assert watch.stale(10**12) is None


def test_frames_are_stale_for_a_while_after_time_stood_still():
    watch = DisplayWatch(object(), 0.5)  # type: ignore[arg-type]
    second = 10**9
    assert watch.stale(0) is None
    assert watch.look(second) == []
    assert "waiting for fresh frames" in watch.stale(11 * second).words
    assert watch.look(11 * second) == [Notice(Event.CLOCK_JUMPED, "the program stood still for 10.0 s")]
    assert watch.look(11 * second) == []
    assert watch.stale(11 * second + round(0.9e9 * RESYNC_S))
    assert watch.stale(11 * second + round(1.1e9 * RESYNC_S)) is None


def test_a_clock_watch_knows_standing_still_from_waiting_and_from_suspension(monkeypatch):
    slept = [3 * 10**9]
    monkeypatch.setattr("zeromethod.loop.display_watch.slept_ns", lambda: slept[0])
    watch = ClockWatch(longest_wait_s=1.0)
    longest_ns = round(1e9 * (1.0 + STOOD_STILL_S))
    stood = 2 * longest_ns + 10**6
    for now_ns, sleep_s, words in [
        (0, 0, ""),
        (longest_ns, 0, ""),
        (stood, 0, "the program stood still for 2.5 s"),
        (stood + 10**6, 0, ""),
        (stood + 2 * 10**6, 7, "the host was suspended for 7.0 s"),
        (stood + 3 * 10**6, 0, ""),
    ]:
        slept[0] += sleep_s * 10**9
        assert watch.look(now_ns) == words


def test_notices_are_shown_when_an_event_begins_and_not_while_it_goes_on():
    notices = Notices()
    for expected in [("it beats",), (), (), (), ()]:
        notices.add(Notice(Event.FLICKER, "it beats"))
        assert notices.take() == expected
    for _ in range(QUIET_STEPS - 2):
        assert notices.take() == ()
    notices.add(Notice(Event.FLICKER, "it beats"))
    assert notices.take() == ()
    for _ in range(QUIET_STEPS - 1):
        notices.take()
    notices.add(Notice(Event.FLICKER, "it beats again"))
    assert notices.take() == ("it beats again",)


def test_warnings_are_kept_apart_by_their_words():
    notices = Notices()
    for words in ("mirrored", "night mode", "mirrored"):
        notices.add(Notice(Event.DISPLAY_WARNING, words))
    for _ in range(2):
        notices.add_always(Notice(Event.ZERO_TAKEN, "a new zero"))
    notices.add_events((Event.CAMERA_LOST, Event.FRAMES_DROPPED), "gone")
    assert notices.take() == ("mirrored", "night mode", "a new zero", "a new zero", "gone")


@pytest.mark.parametrize("enabled", [True, False])
def test_paused_collection_puts_everything_back(enabled):
    was_enabled, switch_s = gc.isenabled(), sys.getswitchinterval()
    try:
        (gc.enable if enabled else gc.disable)()
        sys.setswitchinterval(0.004)

        def fail() -> None:
            assert not gc.isenabled()
            assert gc.get_freeze_count() > 0
            assert sys.getswitchinterval() == pytest.approx(SWITCH_S)
            raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError), PausedGC():
            fail()
        assert gc.isenabled() == enabled
        assert gc.get_freeze_count() == 0
        assert sys.getswitchinterval() == pytest.approx(0.004)
    finally:
        (gc.enable if was_enabled else gc.disable)()
        sys.setswitchinterval(switch_s)


def test_garbage_is_collected_when_idle_and_only_then():
    class Knot:
        alive = 0

        def __init__(self) -> None:
            self.me = self
            Knot.alive += 1

        def __del__(self) -> None:
            Knot.alive -= 1

    with PausedGC() as garbage:
        for _ in range(10):
            Knot()
        garbage.idle()
        assert Knot.alive == 10  # not due yet
        kept = [[k] for k in range(COLLECTED_ABOVE + 1)]
        assert Knot.alive == 10
        garbage.idle()
        assert Knot.alive == 0
        del kept
